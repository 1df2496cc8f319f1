"""Findings state what they show, and their page lists them all."""

from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "findings"
SCRIPTS = sorted(FOLDER.glob("*.sh"))
STATED = ("# One expects: ", "# What happens: ", "# Whom it hurts: ", "# Versions: ", " Date: ")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_script_states_what_one_expects_what_happens_whom_it_hurts_and_versions(script: Path) -> None:
    head = script.read_text().partition("set -eu")[0]
    assert [words for words in STATED if words not in head] == []


def test_page_lists_each_script_with_its_first_line() -> None:
    rows = [line for line in (FOLDER / "README.md").read_text().splitlines() if line.startswith("| [")]
    assert rows == [f"| [{script.stem}]({script.name}) | {script.read_text().splitlines()[1][2:]} |" for script in SCRIPTS]
