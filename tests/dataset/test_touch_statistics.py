"""Only datasets with the paper's object sizes are compared with its figures."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.config.settings import Settings
from pipeline.dataset.touch_statistics import has_paper_sizes
from pipeline.engine.plan import Request
from schemas.surfaces import SURFACES
from tests.engine.tiny_stages import pack
from tests.stages.ball_dataset import Given, objects, surfaces


@pytest.mark.parametrize(
    ("metres_per_unit", "diagonal", "expected"),
    [((0, 0), 0.5, True), ((0, 0.001), 0.5, False), ((0, 0), 0.3, False)],
    ids=["scaled", "one of real size", "scaled otherwise"],
)
def test_paper_sizes_require_the_paper_diagonal_for_every_object(
    tmp_path: Path, metres_per_unit: tuple[float, float], diagonal: float, expected: bool
) -> None:
    units = dict(zip("ab", metres_per_unit, strict=True))
    attributes = {"settings": {"diagonal": diagonal}}
    stage = Given(SURFACES, lambda unit: surfaces(unit) | {"metres_per_unit": np.array(units[unit.name])}, (), {}, attributes)
    request: Any = Request(stage=stage, settings=Settings(), manifest="balls", objects=objects(2), preset="draft", seed=0, data=tmp_path)
    pack(request, stage.row)
    assert has_paper_sizes(tmp_path) == expected
