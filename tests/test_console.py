"""Consoles and progress."""

from __future__ import annotations

import re
import sys

from pipeline.console import Meter, console_on


def test_meter_says_without_a_terminal_how_far_the_work_is(monkeypatch, capsys):
    monkeypatch.setattr("pipeline.console.SECONDS_PER_LINE", -1.0)
    with Meter(console_on(sys.stdout), "train [x]", 40, "steps", 7) as meter:
        meter.advance()
        meter.advance("loss 0.5")
    lines = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"train \[x\]: 8 of 40 steps, \d+ s", lines[0])
    assert re.fullmatch(r"train \[x\]: 9 of 40 steps, \d+ s, loss 0.5", lines[1])


def test_meter_says_nothing_of_short_work(capsys):
    with Meter(console_on(sys.stdout), "short", 2, "objects") as meter:
        meter.advance()
        meter.advance()
    assert capsys.readouterr().out == ""
