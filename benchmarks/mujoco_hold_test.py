"""The hold test in MuJoCo: an engine that shares no code with the one that makes grasps."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.mujoco_hand import hand_spec
from pipeline.contrib.exports.convex_parts import convex_parts
from pipeline.formats.mjcf_files import import_mujoco, is_mjcf
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.grasp import Contact, Grasp
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.physics.hand_mjcf import HARD, add_drives
from pipeline.physics.hand_urdf import gel_name
from pipeline.physics.hold_test import HoldTest, gel_spring
from pipeline.store.temporary import temporary_folder

TIMESTEP = 0.002
"""s; at 1/240 s with a gain that is stable there, fingers sag and drop the object."""
GAIN = {"revolute": 100.0, "continuous": 100.0, "prismatic": 1e5}
"""N m/rad and N/m of a motor: 0.7 N m at 7 mrad, 20 N at 0.2 mm."""
PLATE_TURN = 3.0
"""Moment about the normal that a gel's contact resists, as a multiple of that of its area (`GelSpring.torsion`): a plate meets a convex
part at one or two points, and in PyBullet at up to four, near its corners. With 1, eight of 125 objects of 0.15 m
have another verdict than in PyBullet, with 3 four."""
HAND, GEL = 1, 2
"""Collision bits: links collide with links, links and gels with the object, gels with no part of the hand."""


class MujocoHoldTest(HoldTest):
    """`HoldTest` in MuJoCo. The object is its convex parts, motors are springs with the hand's torque."""

    sample_interval = 0.02

    def _open(self) -> None:
        self.mujoco = import_mujoco()
        self._spec = self._hand_spec(self._opened.enter_context(temporary_folder()))

    def _hand_spec(self, folder: Path) -> Any:
        """Make MuJoCo's description of the hand, which reads meshes in the folder."""
        mujoco, hand = self.mujoco, self.hand
        spec = hand_spec(hand, self.sensors, folder)
        spec.option.timestep = TIMESTEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio, spec.option.noslip_iterations = 10, 2
        gels = [gel_name(number) for number in range(len(self.sensors))]
        for geom in spec.geoms:
            if not (geom.contype or geom.conaffinity):  # for the eye
                continue
            geom.contype, geom.conaffinity = (GEL, 0) if geom.parent.name in gels else (HAND, HAND)
            geom.priority, geom.condim = 1, 4  # the hand's friction counts
            geom.friction = [hand.friction, self.torsion or 0.0, 0.0]
            geom.solref[:], geom.solimp[:] = HARD["solref"], HARD["solimp"]
        add_drives(spec, hand, GAIN)
        for gel in gels:
            lock = spec.add_equality(name=gel, type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, active=False, **HARD)
            lock.name1 = gel
            lock.data[:] = 0.0
        return spec

    def load(self, mesh: Mesh, points: Array) -> None:
        """Replace everything by the hand and an object; see `HoldTest.load`."""
        mujoco, spec = self.mujoco, self._spec.copy()
        centre = points.mean(axis=0)
        squares = ((points - centre) ** 2).mean(axis=0)
        body = spec.worldbody.add_body(name="object", pos=centre, ipos=np.zeros(3), mass=self.mass, explicitinertial=True)
        body.inertia = self.mass * (squares.sum() - squares)
        body.add_freejoint(name="object")
        for number, vertices in enumerate(convex_parts(mesh)):
            shape = spec.add_mesh(
                name=f"part {number}", uservert=(vertices - centre).ravel(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            )
            bits = HAND | GEL
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=shape.name, mass=0.0, contype=bits, conaffinity=bits, **HARD)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)

    def _begin(self, grasp: Grasp, *, closes: bool) -> float:
        model, data, hand = self.model, self.data, self.hand
        root = model.body(hand.links[0].name).id
        model.body_pos[root] = grasp.hand_pose[:3, 3]
        model.body_quat[root] = Rotation.from_matrix(grasp.hand_pose[:3, :3]).as_quat(scalar_first=True)
        self.mujoco.mj_resetData(model, data)
        start = grasp.pregrasp_angles if closes else grasp.joint_angles
        for name, angle in zip(hand.joint_names, start, strict=True):
            data.joint(name).qpos = angle
        for follower in hand.followers:
            data.joint(hand.joints[follower.link - 1].name).qpos = follower.of(start)
        for name, angle in hand.frozen.items() if is_mjcf(hand.model) else ():  # they are fixed in a URDF
            data.joint(name).qpos = angle
        for number, contact in enumerate(grasp.contacts):
            self._press(number, contact, out=closes)
        self.mujoco.mj_forward(model, data)
        bodies = model.geom_bodyid[data.contact.geom]
        distances = data.contact.dist[(bodies == model.body("object").id).any(axis=-1)]
        return max(-float(distances.min(initial=0.0)), 0.0)

    def _accelerate(self, acceleration: Sequence[float]) -> None:
        self.model.opt.gravity[:] = acceleration

    def _drive(self, posture: Array) -> None:
        self.data.ctrl[:] = posture

    def advance(self, seconds: float) -> None:
        self.mujoco.mj_step(self.model, self.data, nstep=round(seconds / TIMESTEP))

    def _press(self, number: int, contact: Contact | None, *, out: bool) -> None:  # type: ignore[override]
        """Move a gel to its contact, or with `out` to its surface, and set its spring."""
        model, sensor, name = self.model, self.sensors[number], gel_name(number)
        spring = gel_spring(sensor, contact, friction=self.hand.friction)
        joint = model.joint(name)
        self.data.joint(name).qpos = gel_top(sensor) if out and contact else spring.height
        joint.stiffness, joint.damping = spring.stiffness, spring.damping
        self.data.eq_active[model.equality(name).id] = contact is None
        model.qpos_spring[joint.qposadr] = gel_top(sensor)
        model.geom_friction[model.body(name).geomadr, 1] = PLATE_TURN * spring.torsion if self.torsion is None else self.torsion

    def _object_pose(self) -> Array:
        """Read the pose; after a numerical failure MuJoCo has reset itself, and the pose is NaN."""
        warnings = self.mujoco.mjtWarning
        failed = any(self.data.warning[kind].number for kind in (warnings.mjWARN_BADQPOS, warnings.mjWARN_BADQVEL, warnings.mjWARN_BADQACC))
        return np.full(7, np.nan) if failed else self.data.joint("object").qpos.copy()
