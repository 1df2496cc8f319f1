"""The summary's tables: of any hand, by its own names."""

import io

import numpy as np
from rich.console import Console

from pipeline.console import show_tables
from pipeline.reports.touch_tables import Tally, touch_tables


def test_a_hand_of_other_fingers_is_told_by_its_names():
    touched = np.array([[True, False, True], [True, False, False]])
    entry = Tally([touched], [np.array([1.0, 0.25, 0.5])], attempts=4)
    written = io.StringIO()
    show_tables(Console(file=written, width=120), touch_tables({"mug": entry}, ["left", "right [1]", "tail"], paper=True))
    lines = [line.split() for line in written.getvalue().splitlines()]
    assert ["grasps", "left", "right", "[1]", "tail"] in lines
    assert ["kept", "100.0", "0.0", "50.0"] in lines
    assert ["all", "attempts", "100.0", "25.0", "50.0"] in lines
    assert ["here", "0.0", "50.0", "50.0", "0.0"] in lines
    assert not any(line[:2] == ["Smith", "et"] for line in lines)  # its hand has four


def test_share_held_in_the_hold_test_is_told_where_it_was_asked_for():
    entry = Tally([np.ones((2, 2), bool)], [np.ones(2)], attempts=2, held=[np.array([[50.0, 120.0, 0.3]] * 2)])
    for lifted, expected in (([], "100.0"), ([np.array([True, False])], "50.0")):
        entry.lifted = lifted
        written = io.StringIO()
        show_tables(Console(file=written, width=160), touch_tables({"mug": entry}, ["left", "right"], paper=False))
        lines = written.getvalue().splitlines()
        start = next(number for number, line in enumerate(lines) if "area of contact" in line)
        assert next(line.split()[-1] for line in lines[start:] if line.split()[:1] == ["mug"]) == expected


def test_columns_of_the_paper_are_left_out_where_sizes_differ():
    entry = Tally([np.ones((2, 4), bool)], [np.ones(4)], attempts=2)
    for paper in (True, False):
        tables = touch_tables({"bottle": entry}, list("abcd"), paper=paper)
        assert ("% in Smith et al. 2020" in tables[0].columns) == paper
        assert ("71.8" in str(tables[0].rows)) == paper
        assert any(row.cells[0] == "Smith et al. 2020" for table in tables for row in table.rows) == paper
