"""The files and sensors of a hand, for keys and settings."""

from pathlib import Path
from typing import NamedTuple

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import sensor_names


class HandListing(NamedTuple):
    """What a hand is described by."""

    files: list[Path]  # as `Hand.files`
    sensors: list[str]  # as `sensor_names`


def list_hand(name: str | Path) -> HandListing:
    """List a hand's files and sensors."""
    hand = load_hand(name)
    return HandListing(hand.files, list(sensor_names(hand)))
