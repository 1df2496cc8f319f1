"""`vt-pipeline tradeoff` and `vt-pipeline advise`, as a user types them."""

from pathlib import Path

import pytest

from pipeline.config.manifest import load_manifest
from pipeline.tradeoff.measure import Setup, stage_key
from stages.registry import DATASET
from tests.command_line import vt
from tests.tradeoff.measured_trades import point, trade


@pytest.fixture
def measured(tmp_path: Path) -> Path:
    """Make a data directory with trades of every dataset stage, written without measuring."""
    own = Setup(tmp_path, "toy", (), load_manifest("toy").seed, "draft")
    for stage in DATASET:
        name = {"render-vision": "resolution", "simulate-touch": "gel_bits"}.get(
            stage, "points" if stage == "sample-surfaces" else "attempts"
        )
        points = point("own", 2, [1, 1, 1, 1]), point("fast", 1, [2, 2, 2, 2], **{name: 16})
        trade(stage, "mm", *points).model_copy(update={"key": stage_key(stage, own)}).write(tmp_path)
    return tmp_path


def test_tradeoff_measures_draws_and_prints(tmp_path: Path) -> None:
    output = vt("tradeoff", "sample-surfaces", "--data", tmp_path, "--minutes", 0.1, "--set", "sample-surfaces.directions=16")
    assert "sample-surfaces: about" in output
    assert "sample-surfaces: distance from the surface to the nearest point, RMS, mm" in output
    assert "draft, standard, paper" in output
    assert "draft, standard, paper" in (tmp_path / "tradeoff" / "sample-surfaces.svg").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["tradeoff", "evaluate"], "unknown stage evaluate; choose from sample-surfaces"),
        (["tradeoff", "--until", "train-gcn"], "--until train-gcn: only evaluate ends a pipeline"),
        (["tradeoff", "--data", "s3://bucket/x"], "measure into a folder on this machine"),
        (["advise"], "give either --within or --error"),
        (["advise", "--within", "3h", "--error", "1mm"], "give either --within or --error"),
        (["advise", "--within", "3 years", "--data", "/nonexistent"], "'3 years' is not a time"),
        (["advise", "--error", "x", "--data", "/nonexistent"], "'x' is not an error"),
        (
            ["advise", "--within", "3h", "--data", "/nonexistent"],
            "sample-surfaces: not measured yet; name the --data of `vt-pipeline tradeoff`, or run `vt-pipeline tradeoff sample-surfaces",
        ),
        (["advise", "--error", "1mm", "--data", "s3://bucket/x"], "give the folder that `vt-pipeline tradeoff` measured into"),
    ],
)
def test_error_names_the_remedy(arguments: list[str], message: str) -> None:
    assert message in vt(*arguments, fails=True)


def test_advice_keeps_the_limits_of_time_and_error(measured: Path) -> None:
    output = vt("advise", "--data", measured, "--within", "13min", "--count", 100, "--cores", 1)
    assert "100 objects on 1 core" in output
    assert "measured on 4 objects, a machine" in output
    assert output.endswith("--preset draft --set sample-surfaces.points=16")
    assert "fast" in vt("advise", "--data", measured, "--error", "2.5mm", "--cores", 2)
    assert "at best 1 mm is kept to" in vt("advise", "--data", measured, "--error", "0.5mm", fails=True)
    output = vt("advise", "--data", measured, "--within", "1min", "--count", 100, "--cores", 1, fails=True)
    assert "the fastest settings take 400 s" in output


def test_advice_refuses_figures_of_other_settings(measured: Path) -> None:
    output = vt("advise", "--data", measured, "--within", "1h", "--set", "sample-surfaces.diagonal=0.3", fails=True)
    assert "measured with other settings or other code; name the --data of `vt-pipeline tradeoff`, or run `vt-pipeline tradeoff" in output
    assert "--set sample-surfaces.diagonal=0.3" in output
