"""The default hand, loaded once; convex parts are kept apart from the user's."""

from collections.abc import Iterator
from pathlib import Path

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


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder / "vt-pipeline" / "convex-parts"
