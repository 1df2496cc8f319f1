"""One renderer for all tests of the vision kernels: what it shows depends on nothing it showed before."""

from collections.abc import Iterator

import pytest

from pipeline.kernels.vision.raster import RasterRenderer
from tests.vision.shapes import SCENE


@pytest.fixture(scope="session")
def renderer() -> Iterator[RasterRenderer]:
    with RasterRenderer(SCENE) as opened:
        yield opened
