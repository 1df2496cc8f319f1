"""Plots of a report."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.contrib.report.plots import draw_curves, draw_histogram
from pipeline.contrib.report.results import training_losses
from pipeline.errors import StoreError

FORMULA = r"$\frac{$"
"""What matplotlib cannot read as a formula."""


def test_names_with_dollars_are_drawn_literally(tmp_path: Path) -> None:
    draw_histogram(tmp_path / "areas.svg", {FORMULA: np.ones(3), "a\x00b": np.ones(2)}, x="x", y="y")
    drawn = (tmp_path / "areas.svg").read_text()
    assert FORMULA in drawn
    assert "a\\x00b" in drawn


def test_histogram_with_a_limit_counts_what_lies_beyond_its_decades(tmp_path: Path) -> None:
    draw_histogram(tmp_path / "speed.svg", {"_": np.array([0.0, 1e-9, 3.0, 1e9, np.inf])}, x="speed", y="%", limit=10.0)
    drawn = (tmp_path / "speed.svg").read_text()
    assert "speed" in drawn
    assert "stroke-dasharray" in drawn  # the limit


def test_learning_curves_keep_the_powers_of_their_ticks_and_need_losses(tmp_path: Path) -> None:
    (tmp_path / "metrics.json").write_text(json.dumps([{"loss": 0.1, "train_loss": 10.0}, {"loss": 0.01, "train_loss": 0.001}]))
    draw_curves(*training_losses(tmp_path), tmp_path / "curves.svg")
    drawn = re.sub("<!--.*?-->", "", (tmp_path / "curves.svg").read_text())
    assert "epoch" in drawn
    assert "mathdefault" not in drawn
    for damage in ("", "[]", "{}", "[1]", '[{"loss": 1}]'):
        (tmp_path / "metrics.json").write_text(damage)
        with pytest.raises(StoreError, match=r"metrics.json lacks the losses"):
            training_losses(tmp_path)
