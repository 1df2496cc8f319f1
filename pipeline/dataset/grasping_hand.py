"""The hand that grasped, as stored attributes name it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.model import Hand


def grasping_hand(attributes: Mapping[str, Mapping[str, Any]]) -> Hand:
    """Load the hand that grasped.

    Parameters
    ----------
    attributes
        Of the roots of artifacts, by name: of `grasps`, and of `vision` where images were rendered.

    Notes
    -----
    The file may have been moved since the grasps were made: `render-vision` took its path as a setting, and drew no other one.
    """
    return load_hand(attributes.get("vision", attributes["grasps"])["settings"]["hand"])
