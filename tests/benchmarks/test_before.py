"""The comparison with an earlier commit: its commands exist, and figures are those of the named checkout, per item."""

from pathlib import Path

import pytest

from benchmarks import before
from benchmarks.before import ROWS, Checkout, Row, compare
from benchmarks.faces import SECTIONS, table
from stages.registry import STAGES


def test_rows_run_stages_that_exist():
    commands = [command.split() for row in ROWS.values() for command in (row.command, *row.needs)]
    assert {words[2] for words in commands if words[:2] == ["vt-pipeline", "run"]} <= {*STAGES}


def test_rows_are_measured_in_turns_in_their_folders_and_per_item(tmp_path, monkeypatch):
    monkeypatch.setattr(before, "ROWS", {"row": Row("A row", "python script.py", ["python make.py"], "data/out", items=4, prints=True)})
    checkouts = []
    for name, seconds in (("before", 8), ("now", 2)):
        (root := tmp_path / f"{name}-root").mkdir()
        (root / "make.py").write_text("from pathlib import Path; Path('data').mkdir()")
        fails_if_not_removed = "from pathlib import Path; Path('data/out').mkdir(); Path('data/out.json').open('x')"
        (root / "script.py").write_text(f"{fails_if_not_removed}; print({seconds})")
        checkouts.append(Checkout(root, tmp_path / name))
    (row,) = compare(*checkouts, ["row"], rounds=3).rows
    assert row[:4] == ("A row", "2.00", "0.500", "0.25")


def test_failed_command_is_named_with_what_it_printed(tmp_path: Path):
    (root := tmp_path / "root").mkdir()
    (root / "script.py").write_text("raise SystemExit('no luck')")
    with pytest.raises(SystemExit, match=r"script\.py.*\nno luck"):
        Checkout(root, tmp_path / "folder").run("python script.py")


def test_slope_is_the_exponent_of_the_last_two_decades():
    stages = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch")
    text = table({power: dict.fromkeys(stages, (10.0**power, 100.0 * 10 ** (power / 2))) for power in SECTIONS})
    assert "| `sample-surfaces`, s | 100 | 1000 | 10000 | 100000 | 1000000 | 1.00 |" in text
    assert text.count("| 0.50 |") == len(stages)
