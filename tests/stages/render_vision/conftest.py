"""One renderer for all tests of the vision kernels: what it shows depends on nothing it showed before."""

from collections.abc import Iterator

import pytest

from stages.render_vision.renderer import Renderer
from tests.kernels.vision.shapes import SCENE


@pytest.fixture(scope="session")
def renderer() -> Iterator[Renderer]:
    with Renderer(SCENE) as opened:
        yield opened
