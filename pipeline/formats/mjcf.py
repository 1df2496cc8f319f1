"""MJCF files: the links and joints of a hand, as MuJoCo reads them. The format: https://mujoco.readthedocs.io/en/stable/XMLreference.html.

MuJoCo parses and compiles the file: defaults, angles, frames, scales and inertias are its own. A body with several joints becomes a chain
of links, the last with its name and frame. Poses are rounded: the C library's sine gives them, whose last digits are the processor's.
"""

from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from pipeline.errors import InvalidInput, missing_name
from pipeline.formats.mesh_parts import MAX_FACES
from pipeline.formats.mesh_reader import read_within_limits
from pipeline.formats.mjcf_couplings import Couplings
from pipeline.formats.mjcf_files import compile_spec, import_mujoco, read_spec
from pipeline.formats.urdf import MAX_PARTS, refuse_namesakes
from pipeline.formats.urdf_shapes import PRIMITIVES, check_unit
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.geometry.transforms import compose, length, rotation_from_euler, transform_points
from pipeline.kernels.hand.kinematics import joint_motion
from pipeline.kernels.hand.model import HandModel, Inertial, Joint, Link, Shape

DIGITS = 10  # decimals of poses, m and rad
SHOWN = 2  # largest group of geoms that MuJoCo's viewer shows unasked
DEFAULT_COLOR = (0.5, 0.5, 0.5, 1.0)  # of a geom whose material counts
COUNTED = {
    "camera": "ncam",
    "light": "nlight",
    "site": "nsite",
    "sensor": "nsensor",
    "keyframe": "nkey",
    "excluded contact": "nexclude",
    "skin": "nskin",
    "flex": "nflex",
}
"""What a grasp does not need, and its count in a MuJoCo model."""


def read_mjcf(path: Path, root: str | None = None) -> HandModel:
    """Read the links and joints of an MJCF, as `read_urdf`, in a process of limited memory and time; see `parse_mjcf`."""
    try:
        model: HandModel = read_within_limits("mjcf", "parse_mjcf", path, root or "")
        return model
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from error


def parse_mjcf(path: Path, root: str) -> HandModel:
    """Read the body `root`, or the first one below the world, and the bodies below it, in this process."""
    spec, files = read_spec(path)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False  # they would drop links and what is seen
    model = compile_spec(spec)
    return _Reader(model, root).hand_model(files)


class _Reader:
    """Reads a part of a compiled model. Its arrays: https://mujoco.readthedocs.io/en/stable/APIreference/APItypes.html#mjmodel."""

    def __init__(self, model: Any, root: str) -> None:
        self.mujoco, self.model = import_mujoco(), model
        self.body_names = [model.body(body).name or f"body {body}" for body in range(model.nbody)]
        if root and root not in self.body_names:
            raise InvalidInput(missing_name("body", root, self.body_names))
        first = self.body_names.index(root) if root else min(1, model.nbody - 1)
        self.bodies = [first]
        for body in range(first + 1, model.nbody):  # parents first
            self.bodies += [body] if model.body_parentid[body] in self.bodies else []
        self.notes: list[str] = []
        self.links: list[Link] = []
        self.joints: list[Joint] = []
        self.numbers: dict[int, int] = {}  # of links, by body
        self.faces = 0

    def hand_model(self, files: list[Path]) -> HandModel:
        model = self.model
        moving = [joint for body in self.bodies[1:] for joint in self._joints_of(body)]
        if (parts := len(self.bodies) + len(moving) + int(np.isin(model.geom_bodyid, self.bodies).sum())) > MAX_PARTS:
            raise InvalidInput(f"it has {parts} bodies, joints and geoms, {MAX_PARTS} are the most")
        self.joint_names = {joint: self._joint_name(joint) for joint in range(model.njnt)}
        self.couplings = Couplings(self.mujoco, model, self.joint_names, moving, self.bodies)
        for body in self.bodies:
            self._add_body(body)
        refuse_namesakes("link", [link.name for link in self.links])
        refuse_namesakes("joint", [joint.name for joint in self.joints])
        counts = [f"{count} {name}{'s' * (count > 1)}" for name, attribute in COUNTED.items() if (count := getattr(model, attribute))]
        ignored = [f"ignored, as grasps do without: {', '.join(counts)}"] if counts else []
        notes = (*ignored, *self.couplings.notes, *self.notes)
        return HandModel(tuple(self.links), tuple(self.joints), tuple(files[1:]), notes, self.couplings.least_force)

    def _joints_of(self, body: int) -> range:
        first = int(self.model.body_jntadr[body])
        return range(first, first + int(self.model.body_jntnum[body]))

    def _joint_name(self, joint: int) -> str:
        return str(self.model.joint(joint).name) or f"joint {joint} of {self.body_names[self.model.jnt_bodyid[joint]]}"

    def _add_body(self, body: int) -> None:
        """Add a body: a link for each of its joints, and one more where the last does not turn about the body's origin."""
        model, name = self.model, self.body_names[body]
        shown, colliding = self._shapes(body)
        link = Link(name, shown, colliding, self._inertial(body))
        if self.links:
            frame, steps = _pose(model.body_pos[body], model.body_quat[body]), list[tuple[int | None, Array]]()
            for joint in self._joints_of(body):
                anchor = model.jnt_pos[joint]
                steps.append((joint, compose(frame, _pose(anchor))))
                frame = _pose(-anchor)
            if not steps or np.any(frame[:3, 3]):
                steps.append((None, frame))
            parent = self.numbers[int(model.body_parentid[body])]
            for step, (number, origin) in enumerate(steps, 1):
                if number is None:
                    self.joints.append(_fixed(f"{name}/fixed", parent, len(self.links), origin))
                else:
                    self.joints.append(self._joint(number, parent, origin))
                parent = len(self.links)
                if step < len(steps):
                    self.links.append(Link(f"{name}/{self.joints[-1].name}", (), ()))
        self.numbers[body] = len(self.links)
        self.links.append(link)

    def _joint(self, number: int, parent: int, origin: Array) -> Joint:
        """Read a joint. Its value is MuJoCo's, which is `ref` where the body is as the file says."""
        model, child, types = self.model, len(self.links), self.mujoco.mjtJoint
        name = self.joint_names[number]
        kind = {types.mjJNT_HINGE: "revolute", types.mjJNT_SLIDE: "prismatic"}.get(types(int(model.jnt_type[number])))
        if kind is None:
            raise InvalidInput(f"joint {name} is a ball joint; write three hinges in its place")
        axis = np.round(model.jnt_axis[number], DIGITS)
        axis /= length(axis)
        rest = float(model.qpos0[model.jnt_qposadr[number]])
        origin = compose(origin, joint_motion(kind, axis, self.couplings.held.get(number, 0.0) - rest))
        if number in self.couplings.held:
            return _fixed(name, parent, child, origin)
        mimic, limited = self.couplings.mimics.get(name), bool(model.jnt_limited[number])
        if not limited and kind == "prismatic" and mimic is None:
            raise InvalidInput(f"joint {name} slides without a limit; give it a range")
        lower, upper = model.jnt_range[number].tolist() if limited else (0.0, 0.0)
        check_unit(f"joint {name} has limits", (lower, upper), slides=kind == "prismatic")
        pose, rpy = _settled(origin)
        return Joint(
            name,
            kind if limited or kind == "prismatic" else "continuous",
            parent,
            child,
            pose,
            axis,
            lower,
            upper,
            mimic=mimic,
            rpy=rpy,
            damping=float(model.dof_damping[model.jnt_dofadr[number]]),
            friction=float(model.dof_frictionloss[model.jnt_dofadr[number]]),
        )

    def _inertial(self, body: int) -> Inertial | None:
        model = self.model
        if not (mass := float(model.body_mass[body])):
            return None
        pose, rpy = _settled(_pose(model.body_ipos[body], model.body_iquat[body]))
        xx, yy, zz = model.body_inertia[body].tolist()
        return Inertial(mass, pose[:3, 3], rpy, (xx, 0.0, 0.0, yy, 0.0, zz))

    def _shapes(self, body: int) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
        """Read what is seen of a body, and what collides: where no geom is there to be seen only, those that collide are seen too."""
        model, first = self.model, int(self.model.body_geomadr[body])
        geoms = range(first, first + int(model.body_geomnum[body]))
        paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
        colliding = [geom for geom in geoms if model.geom_contype[geom] or model.geom_conaffinity[geom] or geom in paired]
        shown = [geom for geom in geoms if model.geom_group[geom] <= SHOWN and self._color(geom)[3] > 0]
        seen = [geom for geom in shown if geom not in colliding] or shown
        shapes = {geom: shape for geom in {*seen, *colliding} if (shape := self._shape(geom, body))}
        return (
            tuple(shapes[geom] for geom in seen if geom in shapes),
            tuple(shapes[geom] for geom in colliding if geom in shapes),
        )

    def _shape(self, geom: int, body: int) -> Shape | None:
        from trimesh import creation

        model, types = self.model, self.mujoco.mjtGeom
        geom_type = types(int(model.geom_type[geom]))
        pose, rpy = _settled(_pose(model.geom_pos[geom], model.geom_quat[geom]))
        x, y, z = model.geom_size[geom].tolist()  # halves, in MuJoCo
        sized: dict[Any, tuple[str, tuple[float, ...]]] = {
            types.mjGEOM_BOX: ("box", (2 * x, 2 * y, 2 * z)),
            types.mjGEOM_SPHERE: ("sphere", (x,)),
            types.mjGEOM_CYLINDER: ("cylinder", (x, 2 * y)),
            types.mjGEOM_CAPSULE: ("capsule", (x, 2 * y)),
        }
        kind, size = sized.get(geom_type, ("mesh", (1.0, 1.0, 1.0)))
        if kind != "mesh":
            made = PRIMITIVES[kind][1](creation, *size)
            points, faces = made.vertices, made.faces
        elif geom_type == types.mjGEOM_ELLIPSOID:
            made = creation.icosphere(subdivisions=3)
            points, faces = made.vertices * [x, y, z], made.faces
        elif geom_type == types.mjGEOM_MESH:
            points, faces = self._mesh(int(model.geom_dataid[geom]))
        else:
            name = model.geom(geom).name or f"geom {geom}"
            self.notes.append(f"{name} of {self.body_names[body]} is a plane or a height field, which no hand has: ignored")
            return None
        vertices, corners = np.round(transform_points(pose, np.asarray(points, np.float64)), DIGITS), np.asarray(faces, np.int32)
        self.faces += len(corners)
        if self.faces > MAX_FACES:
            raise InvalidInput(f"its shapes have {self.faces} faces or more, {MAX_FACES} are the most; decimate their meshes")
        red, green, blue = (round(255 * part) for part in np.clip(self._color(geom)[:3], 0, 1).tolist())
        look = Look.plain(len(vertices), len(corners), (red, green, blue))
        return Shape(kind, size, pose, Mesh(vertices, corners, look), rpy=rpy)

    def _mesh(self, number: int) -> tuple[Array, Array]:
        model = self.model
        first, start = int(model.mesh_vertadr[number]), int(model.mesh_faceadr[number])
        points = model.mesh_vert[first : first + int(model.mesh_vertnum[number])]
        return points, model.mesh_face[start : start + int(model.mesh_facenum[number])]

    def _color(self, geom: int) -> Array:
        """Find the colour and opacity of a geom, as MuJoCo's viewer does; a texture counts by its mean."""
        model, material = self.model, int(self.model.geom_matid[geom])
        if material < 0 or not np.allclose(model.geom_rgba[geom], DEFAULT_COLOR):
            return np.array(model.geom_rgba[geom], np.float64)
        color = np.array(model.mat_rgba[material], np.float64)
        texture = int(model.mat_texid[material, self.mujoco.mjtTextureRole.mjTEXROLE_RGB])
        if texture >= 0:
            first, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
            count = int(model.tex_height[texture]) * int(model.tex_width[texture]) * channels
            color[:3] *= model.tex_data[first : first + count].reshape(-1, channels).mean(axis=0)[:3] / 255  # of one channel: grey
        return color


def _fixed(name: str, parent: int, child: int, origin: Array) -> Joint:
    pose, rpy = _settled(origin)
    return Joint(name, "fixed", parent, child, pose, np.array([1.0, 0.0, 0.0]), 0.0, 0.0, rpy=rpy)


def _pose(position: ArrayLike, quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> Array:  # (4, 4)
    pose = np.eye(4)
    pose[:3, :3] = scipy.spatial.transform.Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    pose[:3, 3] = position
    return pose


def _settled(pose: Array) -> tuple[Array, tuple[float, ...]]:
    """Round a pose (4, 4) to `DIGITS`, and return it with its roll, pitch and yaw, rad, from which engines make the same one."""
    angles = np.round(scipy.spatial.transform.Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", suppress_warnings=True), DIGITS) + 0.0
    settled = np.eye(4)
    settled[:3, :3] = rotation_from_euler(angles)
    settled[:3, 3] = np.round(pose[:3, 3], DIGITS) + 0.0
    return settled, tuple(angles.tolist())
