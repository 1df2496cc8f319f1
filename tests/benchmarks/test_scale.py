"""What more objects would take: the simulated scheduling does what can be computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import scale
from benchmarks.scale import CORES, NODES, START, Rates, durations, schedule


def test_a_task_ends_with_its_last_object():
    rates = Rates("x", np.array([2.0]), 1.0, 1.0)
    assert durations(rates, 10 * CORES, 2, np.random.default_rng(0)) == [START + 10.0, START + 10.0]


def test_tasks_of_a_shard_follow_each_other_and_shards_share_the_nodes():
    tasks = [(3600.0, 1800.0)] * (2 * NODES)
    found = schedule(tasks, np.random.default_rng(0), failing=False, keeping=True)
    assert found.hours == pytest.approx(3.0)
    assert found.used == pytest.approx(1.0)
    assert found.interrupted == 0


def test_a_failure_costs_what_was_not_finished(monkeypatch):
    monkeypatch.setattr(scale, "MEAN_HOURS_TO_FAILURE", 10.0)
    tasks = [(3600.0 * 5,)] * NODES
    kept, lost = (schedule(tasks, np.random.default_rng(0), failing=True, keeping=keeping) for keeping in (True, False))
    assert 0 < kept.interrupted <= lost.interrupted
    assert 5 < kept.hours < lost.hours
