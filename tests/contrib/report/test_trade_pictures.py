"""Trades of a data directory in its report."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from pipeline.console import console
from pipeline.contrib.report.html_report import _trades, used_point, write_report
from pipeline.contrib.report.report_source import ReportSource
from pipeline.store.directory import DataDirectory
from stages.registry import resolve
from tests.stages import ball_dataset
from tests.tradeoff.measured_trades import point, trade

TRADE = trade("sample-surfaces", "mm", point("own", 2, [1, 2, 1, 2]), point("fast", 1, [3, 4, 3, 4], points=5000))


def test_point_with_the_used_settings_is_found() -> None:
    own = resolve("sample-surfaces", "draft", ()).results()
    assert used_point(TRADE, own) == TRADE.points[0]
    assert used_point(TRADE, {**own, "points": 5000}) == TRADE.points[1]
    assert used_point(TRADE, {**own, "points": 123}) is None
    assert used_point(TRADE, {**own, "directions": 16}) is None, "a setting that no point varies"


def test_a_setting_that_the_user_left_null_is_compared_with_the_used_one() -> None:
    own = resolve("simulate-touch", "paper", ()).results()
    measured = trade("simulate-touch", "mm", point("own", 2, [1, 2, 1, 2]), preset="paper")
    assert used_point(measured, own | {"sensors": ("digit",)}) == measured.points[0], "sensors are those that the hand wore"
    assert used_point(measured, own | {"gel_bits": 14}) is None


def test_pictures_name_the_used_point_and_sweeps_are_not_used(tmp_path: Path, monkeypatch) -> None:
    TRADE.write(tmp_path)
    (tmp_path / "figures").mkdir()
    fast = resolve("sample-surfaces", "draft", ["points=5000"]).results()
    settings = {"surfaces": fast, "sweeps/sample-surfaces/points=5": fast | {"points": 5}}
    origins = {name: SimpleNamespace(stage="sample-surfaces", settings=values) for name, values in settings.items()}
    source: Any = SimpleNamespace(directory=DataDirectory(tmp_path))
    monkeypatch.setattr("pipeline.contrib.report.html_report.records", lambda directory: origins)
    (picture,) = _trades(source, tmp_path)
    assert "used here: fast" in picture.caption
    assert "own: 2 s, 1.5 mm" in picture.alt
    drawn = (tmp_path / "figures" / "trade-sample-surfaces.svg").read_text()
    assert "seconds per object" in drawn
    assert ">fast<" in drawn
    monkeypatch.setattr("pipeline.contrib.report.html_report.records", lambda directory: {})
    assert [picture.caption for picture in _trades(source, tmp_path)] == ["sample-surfaces, on 4 objects."]


def test_report_shows_trades(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("pipeline.contrib.report.html_report.draw_figures", lambda *_: [])
    ball_dataset.make_data(tmp_path, 1)
    TRADE.write(tmp_path)
    folder = write_report(ReportSource(tmp_path), console).parent
    assert "Speed against accuracy" in (folder / "results.html").read_text()
