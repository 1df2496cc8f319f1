"""The shipped hand, for tests of the hand's kernels."""

import pytest

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.model import Hand


@pytest.fixture(scope="session")
def hand() -> Hand:
    return load_hand("allegro_right")
