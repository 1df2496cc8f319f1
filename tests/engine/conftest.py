import pytest

from schemas.catalogue import ARTIFACTS
from tests.engine.tiny_stages import MEAN, NOISE


@pytest.fixture(autouse=True)
def known_artifacts(monkeypatch):
    """Add the tiny stages' artifacts to the catalogue."""
    for artifact in (NOISE, MEAN):
        monkeypatch.setitem(ARTIFACTS, artifact.name, artifact)
