"""Closing the hand on an object and letting contact settle, in PyBullet."""

from contextlib import AbstractContextManager, ExitStack

import numpy as np
from numpy.typing import NDArray

from pipeline.formats.physics_urdf import write_physics_urdf
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand
from pipeline.physics.hand_body import HandBody
from pipeline.physics.hold_test import DOWN
from pipeline.physics.object_shapes import COLLISION_MARGIN, ObjectShapes
from pipeline.physics.quiet_pybullet import PhysicsClient
from pipeline.store.temporary import temporary_folder

MIN_STEPS = 20
"""Steps before a hand can count as resting: it starts at rest."""
CHECK_EVERY = 10
"""Steps between two looks at the joints."""


class Simulation(AbstractContextManager["Simulation"]):
    """One PyBullet client with the hand and an object, both fixed in the world; only the fingers move.

    It has no window. Use it as a context manager, which disconnects the client.
    """

    def __init__(self, hand: Hand) -> None:
        self.hand = hand
        self.client = PhysicsClient()
        self._folder = ExitStack()
        self._urdf = write_physics_urdf(hand, self._folder.enter_context(temporary_folder()))
        self._shapes = ObjectShapes(self.client)
        self._body: HandBody

    def __exit__(self, *_: object) -> None:
        self.client.disconnect()
        self._folder.close()

    def load(self, mesh: Mesh) -> None:
        """Replace everything by the hand and an object that collides as it is, concave, and never moves.

        The client is reset first: bodies that are removed one by one leave memory behind.
        """
        self.client.resetSimulation()
        self.client.setGravity(*DOWN)
        for shape in self._shapes.create(mesh):
            self.client.changeDynamics(self.client.createMultiBody(0, shape), -1, collisionMargin=COLLISION_MARGIN)
        self._body = HandBody(self.client, self.hand, self._urdf)

    def settle(
        self,
        hand_pose: NDArray[np.float64],
        start: NDArray[np.float64],
        target: NDArray[np.float64],
        *,
        max_steps: int,
        resting_speed: float,
    ) -> tuple[NDArray[np.float64], bool]:
        """Close the fingers from one posture towards another and wait until they rest.

        Parameters
        ----------
        hand_pose
            (4, 4) root link's frame in the world; the root does not move.
        start, target
            (J,) rad.
        max_steps
            Of 1/240 s.
        resting_speed
            Below this all joints count as resting, rad/s; those that slide, below a tenth of it in m/s.

        Returns
        -------
        joint_angles
            (J,) float64 as simulated, rad.
        rests
            Whether they rested in time.
        """
        self._body.place(hand_pose, start, target)
        return self.advance(max_steps=max_steps, resting_speed=resting_speed)

    def advance(self, *, max_steps: int, resting_speed: float) -> tuple[NDArray[np.float64], bool]:
        """Step on until the joints rest; arguments and result as for `settle`."""
        for step in range(1, max_steps + 1):
            self.client.stepSimulation()
            if step >= MIN_STEPS and (step % CHECK_EVERY == 0 or step == max_steps):
                angles, speed = self._body.joint_states()
                if speed < resting_speed:
                    return angles, self._body.gears_hold(angles)
        return self._body.joint_states()[0], False
