"""Tables of the summary for any hand; only datasets with the paper's object sizes are compared with its figures."""

import io
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from pipeline.config.settings import Settings
from pipeline.console import show_tables
from pipeline.dataset.object_rows import has_paper_sizes
from pipeline.engine.plan import Request
from pipeline.formats.sensor_file import load_sensor
from pipeline.store.directory import DataDirectory
from pipeline.tables.touch_tables import SIZES, ObjectTouches, Touches, hold_tables, read_touches, size_bins, touch_tables
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from stages.simulate_touch import SimulateTouch, TouchSettings
from tests.engine.tiny_stages import pack
from tests.stages import ball_dataset
from tests.stages.ball_dataset import Given, objects, surfaces


def test_touch_table_names_the_fingers_of_another_hand():
    touched = np.array([[True, False, True], [True, False, False]])
    entry = ObjectTouches("mug", touched, np.array([1.0, 0.25, 0.5]), np.zeros((len(touched), 3)))
    written = io.StringIO()
    show_tables(touch_tables(Touches([entry], ["left", "right [1]", "tail"], paper=True)), Console(file=written, width=120))
    lines = [line.split() for line in written.getvalue().splitlines()]
    assert ["grasps", "left", "right", "[1]", "tail"] in lines
    assert ["kept", "100.0", "0.0", "50.0"] in lines
    assert ["attempts,", "mean", "over", "objects", "100.0", "25.0", "50.0"] in lines
    assert ["here", "0.0", "50.0", "50.0", "0.0"] in lines
    assert not any(line[:2] == ["Smith", "et"] for line in lines)  # its hand has four


def made(category: str, diagonal: float, held: list[bool], directions: np.ndarray | None = None) -> ObjectTouches:
    """Make an object whose grasps two sensors touch."""
    count = len(held)
    contacts = np.array([[50.0, 120.0, 0.3]] * count, np.float32)
    return ObjectTouches(category, np.ones((count, 2), bool), np.ones(2), contacts, np.array(held), directions, diagonal=diagonal)


def test_share_of_held_grasps_is_reported_by_class_and_size():
    entries = [made("duck", 0.1, [True, True]), made("mug", 0.1, [True, False]), made("mug", 0.3, [False, False])]
    touches = Touches(entries, ["left", "right"], paper=False)
    by_class, by_size = hold_tables(touches)
    assert by_class.columns == ["class", "objects", "grasps", "touches per grasp", "% that hold"]
    assert [by_class.text(row) for row in by_class.rows] == [
        ["duck", "1", "2", "2.00", "100.0"],
        ["mug", "2", "4", "2.00", "25.0"],
        ["all", "3", "6", "2.00", "50.0"],
    ]
    assert [by_size.text(row) for row in by_size.rows] == [["10 cm", "2", "4", "2.00", "75.0"], ["30 cm", "1", "2", "2.00", "0.0"]]
    tables = touch_tables(touches)
    assert by_class in tables
    assert [table.text(table.rows[0]) for table in tables if table.title == "Contacts"] == [["duck", "50", "100.0", "100.0"]]
    assert not hold_tables(
        Touches([ObjectTouches("mug", np.ones((2, 2), bool), np.ones(2), np.zeros((2, 3)))], ["left", "right"], paper=False)
    )


def test_share_of_held_grasps_is_reported_by_each_of_six_directions():
    directions = np.ones((2, 6), bool)
    directions[0, 4] = False  # along -z
    for table in hold_tables(Touches([made("mug", 0.2, [False, True], directions)], ["left", "right"], paper=False)):
        assert table.columns[-7:] == ["% in all", "−x", "+x", "−y", "+y", "−z", "+z"]
        assert table.text(table.rows[-1])[-7:] == ["50.0", "100.0", "100.0", "100.0", "100.0", "50.0", "100.0"]


@pytest.mark.parametrize("seed", range(3))
def test_size_bins_contain_every_object_once_and_differ(seed: int):
    rng = np.random.default_rng(seed)
    diagonals = np.concatenate([np.exp(rng.normal(size=30)), np.full(12, 0.5)])
    bins = size_bins(diagonals)
    assert 2 <= len(bins) <= SIZES
    assert sorted(np.concatenate([*bins.values()]).tolist()) == list(range(len(diagonals)))
    for own, after in itertools.pairwise(bins.values()):
        assert diagonals[own].max() <= diagonals[after].min()
    assert list(size_bins(np.full(7, 0.15))) == ["15 cm"]


def test_columns_of_the_paper_require_its_sizes():
    entry = ObjectTouches("bottle", np.ones((2, 4), bool), np.ones(4), np.zeros((2, 3)))
    for paper in (True, False):
        tables = touch_tables(Touches([entry], list("abcd"), paper=paper))
        assert ("% in Smith et al. 2020" in tables[0].columns) == paper
        assert ("71.8" in str(tables[0].rows)) == paper
        assert any(row.cells[0] == "Smith et al. 2020" for table in tables for row in table.rows) == paper


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


def test_forces_and_depths_of_elastic_gels_are_tabulated_and_said_with_what_is_beyond_layer_and_calibration(tmp_path: Path):
    """In a layer of 2.06 mm, fitted to 1.41 mm, and in one of 5 mm that was not fitted."""
    sensors = [load_sensor("gelsight_mini"), load_sensor("digit")] * 2
    worn = {"sensors": [sensor.model_dump(mode="json") for sensor in sensors]}
    deep = np.zeros((5, 4), np.float32)
    deep[0], deep[1, :2] = [1e-3, 4e-3, 1.5e-3, 0], [2.5e-3, 2.5e-3]
    ball_dataset.make_data(tmp_path, 2)
    assert "Elastic gels" not in [table.title for table in touch_tables(read_touches(tmp_path))]
    balls = next(stage for stage in ball_dataset.stages() if stage.output is TOUCH)
    stage = Given(TOUCH, lambda unit: balls.row(unit) | {"indentation": deep, "force": 2e3 * deep}, (), balls.constants(Settings()), worn)
    request: Any = Request(stage=stage, settings=Settings(), manifest="balls", objects=objects(2), preset="draft", seed=0, data=tmp_path)
    pack(request, stage.row)
    (table,) = (table for table in touch_tables(read_touches(tmp_path)) if table.title == "Elastic gels")
    assert table.text(table.rows[-1]) == ["all", "10", "5.00", "8.00", "2.50", "4.00", "20.0", "40.0"]
    assert [row.cells[0] for row in table.rows] == ["bottle", "knife", "all"]
    shard = DataDirectory(tmp_path).collection(TOUCH).first
    layer, calibration = SimulateTouch().describe_shard(TouchSettings(), shard)
    assert layer.startswith("2 of 10 touches are up to 2.50 mm deep, beyond the gel's elastic layer")
    assert calibration.startswith("4 of 10 touches are up to 2.50 mm deep, beyond the gel's calibration")
