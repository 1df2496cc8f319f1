"""MJCF files: the links and joints of a hand, as MuJoCo reads them. The format: https://mujoco.readthedocs.io/en/stable/XMLreference.html.

MuJoCo parses and compiles the file: defaults, angles, frames, scales and inertias are its own. A body with several joints becomes a chain
of links, the last with its name and frame. Poses are rounded: the C library's sine gives them, whose last digits are the processor's.
Damping, springs, friction and rotors of joints are not read: they suit the file's motors, and MuJoCo's implicit integration; PyBullet's
is explicit.
"""

from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from pipeline.errors import InvalidInput, missing_name
from pipeline.formats.mesh_parts import MAX_FACES
from pipeline.formats.mjcf_couplings import Couplings
from pipeline.formats.mjcf_files import import_mujoco, read_spec, without_files
from pipeline.formats.urdf import MAX_PARTS
from pipeline.formats.urdf_shapes import MAX_NUMBER, MAX_TURN, PRIMITIVES, check_unit
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.geometry.transforms import compose, length, pose_of, rotation_from_euler, transform_points
from pipeline.kernels.hand.kinematics import joint_motion
from pipeline.kernels.hand.model import HandModel, Inertial, Joint, Link, Shape

DIGITS = 10  # decimals of poses, m and rad
MAX_GROUP = 2  # of geoms that MuJoCo's viewer shows unasked
UNNEEDED = ("cameras", "lights", "sites", "sensors", "keys", "textures", "skins", "flexes")
"""Elements that grasps do not need, by their names in `MjSpec`."""
DYNAMICS = {"damping": "dof_damping", "springs": "jnt_stiffness", "friction": "dof_frictionloss", "rotors": "dof_armature"}
"""Dynamics of joints by their names in `MjModel`, each joint's at its first degree of freedom."""
NUMBERS = "body_pos body_mass body_inertia jnt_pos jnt_range qpos0 geom_pos geom_size mesh_vert eq_data wrap_prm"
"""Numbers of a model that are refused beyond `MAX_NUMBER`; MuJoCo takes even NaN."""


def parse_mjcf(path: Path, root: str) -> HandModel:
    """Read the body `root` of an MJCF and the bodies below it; what holds the root is ignored. Call it by `read_within_limits`."""
    mujoco, (spec, files) = import_mujoco(), read_spec(path)
    spec.compiler.fusestatic = spec.compiler.discardvisual = spec.compiler.usethread = False  # two drop links, and what is seen
    spec.memory = -1  # as much as all couplings need
    model = without_files("compile", spec.compile)
    if wrong := [name for name in NUMBERS.split() if not (np.abs(getattr(model, name)) <= MAX_NUMBER).all()]:
        raise InvalidInput(f"it has numbers beyond {MAX_NUMBER:g}, or NaN, which MuJoCo reads as {', '.join(wrong)}")
    names = [model.body(body).name for body in range(1, model.nbody)]  # 0 is the world
    if root not in names:
        raise InvalidInput(missing_name("body", root, names))
    bodies = [names.index(root) + 1]
    for body in range(bodies[0] + 1, model.nbody):  # parents first
        bodies += [body] if model.body_parentid[body] in bodies else []
    parts = sum(int(model.body_jntnum[body] + model.body_geomnum[body]) + 1 for body in bodies)
    if parts > MAX_PARTS:
        raise InvalidInput(f"it has {parts} bodies, joints and geoms, {MAX_PARTS} are the most")
    joints = np.flatnonzero(np.isin(model.jnt_bodyid, bodies[1:]))
    turns = model.jnt_range[[joint for joint in joints if model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_HINGE)]]
    if spec.compiler.degree and 0 < np.abs(turns).max(initial=0.0) < np.radians(MAX_TURN):
        raise InvalidInput('all joints turn by less than 6.3°; are angles in radians? Then write <compiler angle="radian"/>')
    couplings = Couplings(model, joints.tolist())
    reader = _Reader(model, couplings)
    for body in bodies:
        reader.add(model.body(body))
    unneeded = ", ".join(f"{name} ({count})" for name in UNNEEDED if (count := len(getattr(spec, name))))
    notes = [f"elements of the MJCF that grasps do not need are ignored: {unneeded}"] if unneeded else []
    first = {"jnt": joints, "dof": model.jnt_dofadr[joints]}
    if stated := [word for word, name in DYNAMICS.items() if getattr(model, name)[first[name[:3]]].any()]:
        notes.append(f"dynamics of joints, which suit the MJCF's own motors, are ignored: {', '.join(stated)}")
    torque = min((force for force in couplings.forces if np.isfinite(force)), default=None)
    excluded = [sorted(reader.numbers.get(body, -1) for body in divmod(int(pair), 2**16)) for pair in model.exclude_signature]
    return HandModel(
        links=tuple(reader.links),
        joints=tuple(reader.joints),
        files=tuple(files[1:]),
        notes=(*notes, *couplings.notes),
        torque=torque,
        allowed_contacts=frozenset((first, second) for first, second in excluded if first >= 0),
    )


def _kind(enumeration: str, number: Array) -> str:  # (1,)
    """Name a value of an enumeration of MuJoCo's: 3 of `mjtJoint` is "hinge"."""
    name: str = getattr(import_mujoco(), enumeration)(number.item()).name
    return name.partition("_")[2].lower()


class _Reader:
    """Makes links and joints of the bodies of a compiled model."""

    def __init__(self, model: Any, couplings: Couplings) -> None:
        self._model, self._couplings = model, couplings
        self.links: list[Link] = []
        self.joints: list[Joint] = []
        self.numbers: dict[int, int] = {}  # of links, by body
        self._faces = 0

    def add(self, body: Any) -> None:
        """Add a body: a link for each of its joints, and one more where the last does not turn about the body's origin."""
        if self.links:
            frame, steps = _pose(body.pos, body.quat), list[tuple[Any, Array]]()
            for number in range(body.jntadr.item(), body.jntadr.item() + body.jntnum.item()):
                joint = self._model.joint(number)
                steps.append((joint, compose(frame, _pose(joint.pos))))
                frame = _pose(-joint.pos)
            if not steps or frame[:3, 3].any():
                steps.append((None, frame))
            parent = self.numbers[body.parentid.item()]
            for joint, origin in steps:
                if self.joints and len(self.joints) == len(self.links):  # a step of this body is done
                    self.links.append(Link(f"{body.name}/{self.joints[-1].name}", (), ()))
                    parent = len(self.links) - 1
                self.joints.append(self._joint(joint, parent, origin) if joint else self._fixed(f"{body.name}/fixed", parent, origin))
        self.numbers[body.id] = len(self.links)
        self.links.append(Link(body.name, *self._shapes(body), _inertial(body)))

    def _fixed(self, name: str, parent: int, origin: Array) -> Joint:
        pose, rpy = _rounded(origin)
        return Joint(name, "fixed", parent, len(self.links), pose, np.array([1.0, 0.0, 0.0]), 0.0, 0.0, rpy=rpy)

    def _joint(self, joint: Any, parent: int, origin: Array) -> Joint:
        """Read a joint. Its value is MuJoCo's, which is `ref` where the body is as the file says."""
        kinds = {"hinge": "revolute" if joint.limited else "continuous", "slide": "prismatic"}
        kind = kinds.get(_kind("mjtJoint", joint.type))
        if kind is None:
            raise InvalidInput(f"joint {joint.name} is a ball joint; write three hinges in its place")
        mimic, held = self._couplings.mimics.get(joint.id), self._couplings.held.get(joint.id)
        axis = np.round(joint.axis, DIGITS)
        axis /= length(axis)
        origin = compose(origin, joint_motion(kind, axis, (held or 0.0) - joint.qpos0.item()))
        if held is not None:
            return self._fixed(joint.name, parent, origin)
        if kind == "prismatic" and not joint.limited and mimic is None:
            raise InvalidInput(f"joint {joint.name} slides without a limit; give it a range")
        if joint.range[0] > joint.range[1]:  # which MuJoCo takes for no range
            raise InvalidInput(f"joint {joint.name} has the range {joint.range.tolist()}; write the lower limit first")
        lower, upper = joint.range.tolist() if joint.limited else (0.0, 0.0)
        check_unit(f"joint {joint.name} has limits", (lower, upper), slides=kind == "prismatic")
        low, high = np.clip(self._couplings.reach.get(joint.id, (lower, upper)), lower, upper).tolist()
        if joint.limited and low < high and (low, high) != (lower, upper):
            self._couplings.notes.append(
                f"joint {joint.name} has limits {lower:.4g} … {upper:.4g}; its actuator reaches {low:.4g} … {high:.4g}, which counts"
            )
            lower, upper = low, high
        pose, rpy = _rounded(origin)
        return Joint(joint.name, kind, parent, len(self.links), pose, axis, lower, upper, mimic, rpy)

    def _shapes(self, body: Any) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
        """Read the visuals and collision shapes of a body; one without visuals of its own shows its collision shapes."""
        model = self._model
        numbers = range(body.geomadr.item(), body.geomadr.item() + body.geomnum.item())
        geoms = [geom for geom in map(model.geom, numbers) if _kind("mjtGeom", geom.type) not in ("plane", "hfield")]
        paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
        colliding = [geom.id for geom in geoms if geom.contype or geom.conaffinity or geom.id in paired]
        shown = [geom.id for geom in geoms if geom.group <= MAX_GROUP and self._color(geom)[3] > 0]
        seen = [number for number in shown if number not in colliding] or shown
        shapes = {geom.id: self._shape(geom) for geom in geoms if geom.id in (*seen, *colliding)}
        return tuple(shapes[number] for number in seen), tuple(shapes[number] for number in colliding)

    def _shape(self, geom: Any) -> Shape:
        from trimesh import creation

        kind, sizes = _kind("mjtGeom", geom.type), geom.size  # MuJoCo's are halves
        pose, rpy = _rounded(_pose(geom.pos, geom.quat))
        size: tuple[float, ...] = (1.0, 1.0, 1.0)
        if kind in PRIMITIVES:
            size = tuple({"box": 2 * sizes, "sphere": sizes[:1]}.get(kind, sizes[:2] * [1, 2]).tolist())
            body = PRIMITIVES[kind][1](creation, *size)
            vertices, faces = body.vertices, body.faces
        elif kind == "ellipsoid":
            body = PRIMITIVES["sphere"][1](creation, 1.0)
            vertices, faces = body.vertices * sizes, body.faces
        else:
            mesh = self._model.mesh(geom.dataid.item())
            first, start = mesh.vertadr.item(), mesh.faceadr.item()
            vertices = self._model.mesh_vert[first : first + mesh.vertnum.item()].astype(np.float64)
            faces = self._model.mesh_face[start : start + mesh.facenum.item()]
        self._faces += len(faces)
        if self._faces > MAX_FACES:
            raise InvalidInput(f"its shapes have {self._faces} faces or more, {MAX_FACES} are the most; decimate their meshes")
        red, green, blue, _ = (round(255 * part) for part in self._color(geom).tolist())
        look = Look.plain(len(vertices), len(faces), (red, green, blue))
        vertices = np.round(transform_points(pose, vertices), DIGITS)
        return Shape(kind if kind in PRIMITIVES else "mesh", size, pose, Mesh(vertices, np.array(faces, np.int32), look), rpy=rpy)

    def _color(self, geom: Any) -> Array:
        """Find the colour and opacity of a geom: its own, or that of its material where its own is the default, as in MuJoCo's viewer."""
        material = geom.matid >= 0 and (geom.rgba == (0.5, 0.5, 0.5, 1.0)).all()
        return np.clip(np.array(self._model.mat(geom.matid.item()).rgba if material else geom.rgba, np.float64), 0, 1)


def _inertial(body: Any) -> Inertial | None:
    pose, rpy = _rounded(_pose(body.ipos, body.iquat))
    xx, yy, zz = body.inertia.tolist()
    return Inertial(body.mass.item(), pose[:3, 3], rpy, (xx, 0.0, 0.0, yy, 0.0, zz)) if body.mass else None


def _pose(position: ArrayLike, quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> Array:  # (4, 4)
    return pose_of(scipy.spatial.transform.Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), position)


def _rounded(pose: Array) -> tuple[Array, tuple[float, ...]]:
    """Round a pose (4, 4) to `DIGITS`, and return it with its roll, pitch and yaw, rad, from which engines make the same one."""
    angles = scipy.spatial.transform.Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", suppress_warnings=True)
    angles = np.round(angles, DIGITS) + 0.0  # no negative zeros
    return pose_of(rotation_from_euler(angles), np.round(pose[:3, 3], DIGITS) + 0.0), tuple(angles.tolist())
