"""Tables of the summary for any hand, with its names of fingers."""

import io
import itertools

import numpy as np
import pytest
from rich.console import Console

from pipeline.console import show_tables
from pipeline.tables.touch_tables import SIZES, Tally, hold_tables, size_bins, touch_tables


def test_touch_table_names_the_fingers_of_another_hand():
    touched = np.array([[True, False, True], [True, False, False]])
    entry = Tally([touched], [np.array([1.0, 0.25, 0.5])])
    written = io.StringIO()
    show_tables(Console(file=written, width=120), touch_tables({"mug": entry}, ["left", "right [1]", "tail"], paper=True))
    lines = [line.split() for line in written.getvalue().splitlines()]
    assert ["grasps", "left", "right", "[1]", "tail"] in lines
    assert ["kept", "100.0", "0.0", "50.0"] in lines
    assert ["attempts,", "mean", "over", "objects", "100.0", "25.0", "50.0"] in lines
    assert ["here", "0.0", "50.0", "50.0", "0.0"] in lines
    assert not any(line[:2] == ["Smith", "et"] for line in lines)  # its hand has four


def objects_of(held: list[list[bool]], diagonals: list[float], directions: list[list[list[bool]]] | None = None) -> Tally:
    """Make objects of two grasps each, which two sensors touch."""
    count, each = len(held), len(held[0])
    return Tally(
        [np.ones((each, 2), bool)] * count,
        [np.ones(2)] * count,
        hold_measures=[np.array([[50.0, 120.0, 0.3]] * each, np.float32)] * count,
        held=[np.array(own) for own in held],
        held_directions=[np.array(own) for own in directions or []],
        diagonals=diagonals,
    )


def test_share_of_held_grasps_is_reported_by_class_and_size():
    tallies = {"duck": objects_of([[True, True]], [0.1]), "mug": objects_of([[True, False], [False, False]], [0.1, 0.3])}
    by_class, by_size = hold_tables(tallies)
    assert by_class.columns == ["class", "objects", "grasps", "touches per grasp", "% that hold"]
    assert [by_class.text(row) for row in by_class.rows] == [
        ["duck", "1", "2", "2.00", "100.0"],
        ["mug", "2", "4", "2.00", "25.0"],
        ["all", "3", "6", "2.00", "50.0"],
    ]
    assert [by_size.text(row) for row in by_size.rows] == [["10 cm", "2", "4", "2.00", "75.0"], ["30 cm", "1", "2", "2.00", "0.0"]]
    tables = touch_tables(tallies, ["left", "right"], paper=False)
    assert [table for table in tables if "hold" in table.title] == [by_class]
    assert [table.text(table.rows[0]) for table in tables if table.title == "Contacts"] == [["duck", "50", "100.0", "100.0"]]
    untested = {"mug": Tally([np.ones((2, 2), bool)], [np.ones(2)])}
    assert not hold_tables(untested)


def test_share_of_held_grasps_is_reported_by_each_of_six_directions():
    directions = np.ones((1, 2, 6), bool)
    directions[0, 0, 4] = False  # along -z
    (entry,) = (objects_of([[False, True]], [0.2], directions.tolist()),)
    for table in hold_tables({"mug": entry}):
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


def test_columns_of_the_paper_are_left_out_if_sizes_differ():
    entry = Tally([np.ones((2, 4), bool)], [np.ones(4)])
    for paper in (True, False):
        tables = touch_tables({"bottle": entry}, list("abcd"), paper=paper)
        assert ("% in Smith et al. 2020" in tables[0].columns) == paper
        assert ("71.8" in str(tables[0].rows)) == paper
        assert any(row.cells[0] == "Smith et al. 2020" for table in tables for row in table.rows) == paper
