"""The hold test, the door to an engine that tests grasps: an object that is freed in the hand, and how far it moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.physics.motion import Motion

GRAVITY = -9.81
"""m/s², along the world's z."""
DOWN = (0.0, 0.0, GRAVITY)


class HoldTest(Protocol):
    """A hand that is fixed in the world and an object that is free, in a physics engine; `engines.hold_test` opens one.

    Each gel is a plate on a spring (`gel_spring`), which touches the object where the tactile image has it nearest. A gel that does not
    touch is drawn in; rigid links are as in the grasp. Motors hold the posture with no more than the hand's torque.

    An engine is constructed with `hand`, `sensors` (that of each of its mounts), and by keyword `mass` (of the object, kg), `friction`
    (coefficient between hand and object; by default the hand's) and `torsion` (of every link and gel: the moment about the normal that
    friction resists per newton of normal force, m; by default that of the contact's area for gels, and none for links).
    """

    def __enter__(self) -> Self:
        """Return itself."""

    def __exit__(self, *error: object) -> None:
        """Close the engine."""

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
        whole: bool = False,
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
            How long at most: an object that rests ends the test.
        limit
            m that the object's centre may move; beyond, the test ends early.
        whole
            Whether to go on where the object is so slow that it cannot reach the limit any more; then the way in the end is known.

        Notes
        -----
        PyBullet remembers contacts: the grasps that were tested since `load` change where an object ends by less than a millimetre, seldom
        by more.
        """
