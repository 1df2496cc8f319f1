"""A grasp: the pose of the hand, its postures from pre-grasp to squeeze, and where its sensors are and touch."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.hand.grasp_closure import Contact, opposition_angle


@dataclass(frozen=True, eq=False)
class Grasp:
    """A grasp of a hand with J joints and S sensors; angles are rad, or m of a joint that slides."""

    hand_pose: Array  # (4, 4) root link to world, m
    pregrasp_angles: Array  # (J,) from which the fingers close
    joint_angles: Array  # (J,) at which they rest
    squeeze_angles: Array  # (J,) to which the motors drive in order to hold
    sensor_pose: Array  # (S, 4, 4) sensor to world, m
    contacts: Sequence[Contact | None]  # (S,) None for a sensor that does not touch

    @property
    def touched(self) -> Mask:  # (S,)
        """Tell which sensors touch."""
        return np.array([contact is not None for contact in self.contacts])

    @property
    def contact_area(self) -> Array:  # (S,) m²
        """List the areas of the contacts; 0 for a sensor that does not touch."""
        return np.array([contact.area if contact else 0.0 for contact in self.contacts])

    @property
    def opposition(self) -> float:
        """Compute the greatest angle between two contacts' normals, degrees."""
        return opposition_angle([contact for contact in self.contacts if contact])
