"""The hold test, the interface of engines that test grasps: an object is freed in the hand, and its motion recorded."""

from abc import abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.motion import CLOSING_SECONDS, CLOSING_STAGES, Motion, Track, closing_path

GRAVITY = -9.81
"""m/s², along the world's z."""
DOWN = (0.0, 0.0, GRAVITY)


class HoldTest(AbstractContextManager["HoldTest"]):
    """A hand that is fixed in the world and an object that is free, in a physics engine; `engines.hold_test` opens one.

    Each gel is a plate on a spring (`gel_spring`), which touches the object at its nearest point in the tactile image. A gel without
    contact is drawn in and locked; rigid links are as in the grasp. Motors hold the posture with at most the hand's torque.

    Parameters
    ----------
    hand, sensors
        The hand, and the sensor of each of its mounts.
    mass
        Of the object, kg.
    friction
        Coefficient between hand and object; by default the hand's.
    torsion
        Of every link and gel: the moment about the normal that friction resists per newton of normal force, m; by default that of the
        contact's area for gels, and none for links.
    """

    look_interval: float
    """Time between two looks at the object, s."""

    def __init__(
        self, hand: Hand, sensors: Sequence[Sensor], *, mass: float, friction: float | None = None, torsion: float | None = None
    ) -> None:
        self.hand = hand if friction is None else replace(hand, friction=friction)
        self.sensors, self.mass, self.torsion = sensors, mass, torsion
        self.opened = ExitStack()

    def __exit__(self, *_: object) -> None:
        self.opened.close()

    @abstractmethod
    def load(self, mesh: Mesh, points: NDArray[np.float64]) -> None:
        """Replace everything by the hand and an object.

        Parameters
        ----------
        mesh
            The object, world, m.
        points
            (N, 3) of its exterior, m, over which its mass is spread evenly.
        """

    def hold(
        self,
        grasp: StoredGrasp,
        *,
        closes: bool = False,
        acceleration: Sequence[float] = DOWN,
        seconds: float = 1.0,
        limit: float = 0.1,
    ) -> Motion:
        """Free the object in a grasp, whose motors drive to the squeeze, and record how both move.

        Parameters
        ----------
        grasp
            Of the object that is loaded.
        closes
            Whether the fingers first close from the pre-grasp to the grasp and to the squeeze, in a straight line each and without
            gravity; else they begin in the grasp.
        acceleration
            (3,) of gravity on the object and the hand's links, world, m/s².
        seconds
            Longest duration: the test ends early when the object rests.
        limit
            m that the object's centre may move; beyond, the test ends early.

        Notes
        -----
        PyBullet remembers contacts: the grasps that were tested since `load` change where an object ends by less than a millimetre, seldom
        by more.
        """
        penetration = self._begin(grasp, closes)
        start = self._object_pose()
        self._accelerate((0.0, 0.0, 0.0))
        for posture in closing_path(grasp) if closes else ():
            self._drive(posture)
            self._step(CLOSING_SECONDS / CLOSING_STAGES)
        self._accelerate(acceleration)
        self._drive(grasp.squeeze)
        track = Track(start, self._joint_angles(), limit=limit, interval=self.look_interval)
        for _ in range(round(seconds / self.look_interval)):
            self._step(self.look_interval)
            if track.ends(self._object_pose(), self._joint_angles()):
                break
        return track.motion(penetration)

    @abstractmethod
    def _begin(self, grasp: StoredGrasp, closes: bool) -> float:
        """Place hand, gels and object for the start of a test; return the penetration of the hand into the object, m."""

    @abstractmethod
    def _accelerate(self, acceleration: Sequence[float]) -> None:
        """Set the acceleration (3,) that acts from now on, m/s²."""

    @abstractmethod
    def _drive(self, posture: NDArray[np.float64]) -> None:
        """Set the targets (J,) of the motors, rad."""

    @abstractmethod
    def _step(self, seconds: float) -> None:
        """Let time pass."""

    @abstractmethod
    def _joint_angles(self) -> NDArray[np.float64]:
        """Read the joint angles, (J,) rad."""

    @abstractmethod
    def _object_pose(self) -> NDArray[np.float64]:
        """Read the centre, m, and quaternion of the object, (7,); NaN after a numerical failure of the engine."""
