"""Consoles and progress."""

import re
import sys

import pytest
import typer

from pipeline.cli.failures import report_failures
from pipeline.console import Meter, Row, Table, console_on, pluralise, print_lines, show_tables
from pipeline.errors import InvalidInput


def test_meter_prints_progress_lines_without_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr("pipeline.console.SECONDS_PER_LINE", -1.0)
    with Meter(console_on(sys.stdout), "train [x]", 40, "steps", 7) as meter:
        meter.advance()
        meter.advance("loss 0.5")
    lines = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"train \[x\]: 8 of 40 steps, \d+ s", lines[0])
    assert re.fullmatch(r"train \[x\]: 9 of 40 steps, \d+ s, loss 0.5", lines[1])


def test_meter_prints_nothing_for_short_work(capsys):
    with Meter(console_on(sys.stdout), "short", 2, "objects") as meter:
        meter.advance()
        meter.advance()
    assert capsys.readouterr().out == ""


def test_tables_in_a_log_keep_the_ends_of_cells(capsys):
    rows = [Row([f"{'network-' * 9}{end}", *["1.23 (0.45–6.78)"] * 8]) for end in "xyz"]
    show_tables([Table("", ["network", *"abcdefgh"], rows)], console_on(sys.stdout))
    output = capsys.readouterr().out
    assert "…" not in output
    assert all(end in output for end in "xyz")
    assert output.count("6.78)") == 24


def test_control_characters_are_printed_as_escapes(capsys):
    meter = Meter(console_on(sys.stdout), "a\x1b]0;owned\x07b", 1, "steps")
    meter._bar.console.print(meter._bar)
    show_tables([Table("", ["\x9b2J"], [Row(["\u202etxt.exe"])])], console_on(sys.stdout))
    print_lines("é [bold] :smile: \x1b[31mred\n\udcff\x00\u2028")
    output = capsys.readouterr().out
    assert all(character.isprintable() or character == "\n" for character in output)
    for expected in (r"a\x1b]0;", r"\x9b2J", r"\u202et", r"é [bold] :smile: \x1b[31mred" + "\n" + r"\udcff\x00\u2028"):
        assert expected in output


def test_control_characters_of_errors_do_not_reach_the_terminal(capsys):
    @report_failures()
    def command(error: Exception) -> None:
        raise error

    for error in (InvalidInput("a\x1b[2Jb"), KeyError("unforeseen"), RuntimeError("a\x1b[2Jb")):
        with pytest.raises(typer.Exit):
            command(error)
    output = capsys.readouterr().err
    assert "\x1b" not in output
    assert r"error: a\x1b[2Jb" in output
    assert r"RuntimeError: a\x1b[2Jb" in output


def test_pluralise_agrees_with_the_number():
    phrases = [pluralise(1), pluralise(2), *(pluralise(number, noun) for noun in ("class", "touch", "process") for number in (1, 0))]
    assert phrases == ["1 object", "2 objects", "1 class", "0 classes", "1 touch", "0 touches", "1 process", "0 processes"]
