"""Closing the hand on an object and letting contact settle, in PyBullet."""

from contextlib import AbstractContextManager, ExitStack

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand
from pipeline.physics.client import COLLISION_MARGIN, PhysicsClient
from pipeline.physics.hand_body import HandBody
from pipeline.physics.hand_urdf import write_hand_urdf
from pipeline.physics.hold_test import DOWN
from pipeline.store.temporary import temporary_folder

MIN_STEPS = 20  # steps before a hand can count as resting: it starts at rest
CHECK_EVERY = 10  # steps between two samples of the joints


class Simulation(AbstractContextManager["Simulation"]):
    """A PyBullet client with the hand and an object, both fixed in the world; only the fingers move."""

    def __init__(self, hand: Hand) -> None:
        self.hand = hand
        self.client = PhysicsClient()
        self._folder = ExitStack()
        self._urdf = write_hand_urdf(hand, self._folder.enter_context(temporary_folder()))
        self._body: HandBody

    def __exit__(self, *_: object) -> None:
        self.client.disconnect()
        self._folder.close()

    def load(self, mesh: Mesh) -> None:
        """Replace everything by the hand and an object that collides as it is, concave, and never moves."""
        self.client.resetSimulation()  # bodies that are removed one by one leave memory behind
        self.client.setGravity(*DOWN)
        for shape in self.client.create_shapes(mesh):
            self.client.changeDynamics(self.client.createMultiBody(0, shape), -1, collisionMargin=COLLISION_MARGIN)
        self._body = HandBody(self.client, self.hand, self._urdf)

    def settle(
        self,
        hand_pose: Array,  # (4, 4) root link's frame to world; the root does not move
        start: Array,  # (J,) rad
        target: Array,  # (J,) rad
        *,
        max_steps: int,  # of 1/240 s
        resting_speed: float,  # rad/s, below which all joints count as resting; those that slide, below a tenth of it in m/s
    ) -> tuple[Array, bool]:
        """Close the fingers from one posture towards another; return the joint angles (J,), and whether they came to rest in time."""
        self._body.set_pose(hand_pose, start, target)
        return self.advance(max_steps=max_steps, resting_speed=resting_speed)

    def advance(self, *, max_steps: int, resting_speed: float) -> tuple[Array, bool]:
        """Step on until the joints rest; arguments and result as for `settle`."""
        for step in range(1, max_steps + 1):
            self.client.stepSimulation()
            if step >= MIN_STEPS and (step % CHECK_EVERY == 0 or step == max_steps):
                angles, speed = self._body.joint_states()
                if speed < resting_speed:
                    return angles, self._body.gears_hold(angles)
        return self._body.joint_states()[0], False
