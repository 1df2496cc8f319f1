"""Grasps of files on an object: into its world, onto the hand's joints, and measured."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.console import abbreviate, pluralise
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Inputs, Unit
from pipeline.errors import InvalidInput, missing_name
from pipeline.formats.grasp_file import PHASES, FileGrasp, Stated, grasp_files, read_grasp_file
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.transforms import compose, frame_and_scale, length, pose_of
from pipeline.kernels.hand.pregrasp import pregrasp_angles
from pipeline.physics.hold_test import HoldTest
from pipeline.physics.simulation import Simulation
from pipeline.store.rows import Row
from stages.simulate_grasps.grasp_search import OPENING, OVERLOADED, RESTING_SPEED
from stages.simulate_grasps.measured_grasps import Attempt, MeasuredGrasps
from stages.simulate_grasps.prepare import measured_hand, prepare_object
from stages.simulate_grasps.read_stage import ReadSettings, grasp_folder, model_joints

SAME_SCALE = 1e-4  # share by which the scale of a grasp's object may differ from the object's: 0.01 mm at the end of 100 mm
BEYOND = 0.1  # rad (m) that a joint may be beyond its limits, or off its coupling: more is another joint, or another hand
TARGET_BEYOND = 2 * np.pi  # the same before and after the grasp: motors may drive beyond the limits to press
FARTHEST = 10.0  # m, of the hand from the origin of the object's file


@contextmanager
def reading(settings: ReadSettings) -> Iterator[Callable[[Unit, Inputs], Row]]:
    """Prepare the hand; yield what reads the grasps of an object and makes its row."""
    folder, hand = grasp_folder(settings), measured_hand(settings)
    with ExitStack() as opened:
        physics = opened.enter_context(Simulation(hand.hand)) if settings.close else None
        test = None
        if settings.test != "none":
            test = opened.enter_context(HoldTest(hand.hand, hand.sensors, mass=settings.hold_mass))

        def process(unit: Unit, inputs: Inputs) -> Row:
            files = grasp_files(folder, unit.name)
            if not files:
                raise InvalidInput(f"no grasps of it in {folder}; call its file {unit.name}.npz or .npy, or their folder {unit.name}")
            surface = inputs["surfaces"]
            mesh = read_mesh(surface)
            prepared_object = prepare_object(mesh, surface["points"], surface["normals"], reach=hand.reach)
            if physics is not None:
                physics.load(mesh)
            if test is not None:
                test.load(mesh, prepared_object.points)
            measured = MeasuredGrasps(hand, prepared_object, settings, test)
            grasps = (grasp for file in files for grasp in read_grasp_file(file, folder))
            return GraspReader(measured, settings, surface["placement"], physics).row(grasps)

        yield process


class GraspReader:
    """Takes the grasps of one object from its file's frame into the world, and onto the joints of the hand."""

    def __init__(
        self,
        measured: MeasuredGrasps,
        settings: ReadSettings,
        placement: Array,  # (4, 4) points of the object's file to the world, m
        physics: Simulation | None,  # that closes the fingers
    ) -> None:
        self.measured, self.settings, self.physics, self.hand = measured, settings, physics, measured.measured_hand.hand
        self.frame, self.scale = frame_and_scale(placement)
        self.root = pose_of(Rotation.from_quat(settings.root[3:], scalar_first=True).as_matrix(), settings.root[:3])

    def row(self, grasps: Iterable[FileGrasp]) -> Row:
        """Make the row of the first grasps that can be used; the others are named with the reason."""
        kept: list[Attempt] = []
        origins, refused, more = list[str](), list[str](), 0
        for grasp in grasps:
            try:
                if isinstance(grasp.stated, InvalidInput):
                    raise grasp.stated
                if len(kept) == self.settings.grasps:
                    more += 1
                    continue
                kept.append(self.attempt(grasp.stated))
                origins.append(grasp.origin)
            except InvalidInput as error:
                refused.append(" ".join(f"{grasp.origin}: {error}".splitlines()))
        if not kept:
            raise InvalidInput(f"none of its {pluralise(len(refused), 'grasp')} is usable; {refused[0] if refused else 'files are empty'}")
        touched = np.mean([attempt.grasp.touched for attempt in kept], axis=0)
        repeated = np.arange(self.settings.grasps) % len(kept)
        return {
            **{name: values[repeated] for name, values in self.measured.row(kept).items()},
            "attempts": np.array(len(origins) + len(refused) + more, np.int32),
            "attempt_success": touched.astype(np.float32),
            "grasp_files": np.array("\n".join(origins)),
            "refused_grasps": np.array("\n".join(refused)),
        }

    def attempt(self, stated: Stated) -> Attempt:
        """Measure a grasp, closed if the settings ask for it; an `InvalidInput` says why it cannot be used."""
        if abs(stated.scale / self.scale - 1) > SAME_SCALE:
            raise InvalidInput(
                f"it is of an object of {stated.scale:g} m per unit of its file, this one has {self.scale:g}; state metres_per_unit: "
                f"{stated.scale:g} in the manifest, or correct the grasp's"
            )
        hand, pose = self.hand, compose(compose(self.frame, stated.root), self.root)
        if (distance := float(length(stated.root[:3, 3]))) > FARTHEST:
            raise InvalidInput(f"the hand is {distance:.3g} m from the object's origin; positions are in m, in .npz in the mesh's unit")
        angles = {phase: self._joint_vector(stated, phase) for phase in PHASES if phase in stated.angles}
        start, grasp, squeeze = angles.get("pregrasp"), angles["grasp"], angles.get("squeeze")
        if self.physics is not None:
            opened, pressed = pregrasp_angles(hand, grasp, [OPENING, -self.settings.squeeze])
            start, steps = opened if start is None else start, self.settings.settle_steps
            grasp, rests = self.physics.settle(pose, start, pressed, max_steps=steps, resting_speed=RESTING_SPEED)
            if not rests:
                raise InvalidInput(
                    f"fingers still move after {steps} steps (read-grasps.settle_steps): does `vt-pipeline check` of the hand file name "
                    "links that overlap?"
                )
            grasp, within = self.measured.closed(pose, start, grasp)
            if not within:
                raise InvalidInput(f"{OVERLOADED}: is the pregrasp clear of the object?")
        attempt = self.measured.measure(pose, grasp if start is None else start, grasp, squeeze)
        if attempt.fault:
            raise InvalidInput(f"{attempt.fault}: {1e3 * attempt.penetration:.1f} mm; is read-grasps.root right for this hand?")
        return attempt

    def _joint_vector(self, stated: Stated, phase: str) -> Array:  # (J,) rad (m)
        """Put a file's values into the order of the hand's joints, by name."""
        hand, joints, known = self.hand, self.settings.joints, model_joints(self.hand)
        names, values = stated.joints or (not isinstance(joints, dict) and joints) or known, stated.angles[phase]
        if len(names) != len(values):
            raise InvalidInput(
                f"it has {len(values)} values of joints and names none of them, {pluralise(len(names), 'joint')} of hand {hand.name} are "
                "expected; list the names in read-grasps.joints, in the order of the file"
            )
        if isinstance(joints, dict):
            names = [joints.get(name, name) for name in names]
        by_name = dict(zip(names, values.tolist(), strict=True))
        if unknown := [name for name in by_name if name not in known]:
            raise InvalidInput(f"{missing_name('joint', unknown[0][:100], known)}; rename it by read-grasps.joints, or take a hand with it")
        if twice := [name for name in by_name if list(names).count(name) > 1]:
            raise InvalidInput(f"joint {twice[0]!r} is there twice; give each joint one value, or correct read-grasps.joints")
        if lacking := [name for name in hand.joint_names if name not in by_name]:
            raise InvalidInput(f"it has no value for {abbreviate(lacking)} of hand {hand.name}; it is for another hand")
        vector = np.array([by_name[name] for name in hand.joint_names])
        beyond = np.maximum(hand.lower - vector, vector - hand.upper)
        if beyond.max() > (BEYOND if phase == "grasp" else TARGET_BEYOND):
            joint = int(beyond.argmax())
            unit = "m" if hand.joints[hand.joint_links[joint] - 1].kind == "prismatic" else "rad"
            raise InvalidInput(
                f"joint {hand.joint_names[joint]} is {vector[joint]:.3g} in the {phase}, its limits are {hand.lower[joint]:.3g} to "
                f"{hand.upper[joint]:.3g}; is it in {unit}, and do read-grasps.joints and the hand fit the file?"
            )
        for name, value in hand.joint_values(vector).items():
            if phase == "grasp" and abs(by_name.get(name, value) - value) > BEYOND:
                raise InvalidInput(f"joint {name} is {by_name[name]:.3g}, in hand {hand.name} it is {value:.3g}: frozen or coupled")
        return vector
