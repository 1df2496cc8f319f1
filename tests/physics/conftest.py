"""Hands, loaded once."""

import pytest

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.model import Hand
from tests.physics.pincers import load_pincers


@pytest.fixture(scope="session")
def hand() -> Hand:
    return load_hand("allegro_right")


@pytest.fixture(scope="session")
def pincers(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    return load_pincers(tmp_path_factory.mktemp("pincers"))
