"""What is left out changes nothing: every shortcut beside the same work without it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmarks.tradeoff import pairs_data, pairs_learning
from benchmarks.tradeoff.pairs import EQUAL, Pair, difference
from benchmarks.tradeoff.shortcuts import measured


def small() -> dict[str, Pair]:
    """Every pair by name, on a small object and with narrow networks."""
    data = pairs_data.Bench(size=1, attempts=5, points=1500, samples=512)
    learning = pairs_learning.Bench(items=1, layers=4, features=24, width=0.25, unet=2, points=2000, steps=20)
    return {pair.name: pair for pair in (*pairs_data.pairs(data), *pairs_learning.pairs(learning))}


@pytest.fixture(scope="module")
def pairs() -> dict[str, Pair]:
    return small()


@pytest.fixture(autouse=True)
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("name", small())
def test_the_results_are_the_same_without_it(pairs: dict[str, Pair], name: str):
    ours, plain = pairs[name].with_(), pairs[name].without()
    assert any(np.asarray(array).size for array in ours.values())
    assert difference(ours, plain) <= pairs[name].bound


def test_a_difference_is_seen_and_a_bound_is_kept_apart_from_equality():
    a = {"x": np.array([1.0, np.inf]), "n": np.array([2])}
    assert difference(a, {"x": np.array([1.0, np.inf]), "n": np.array([2])}) == 0
    assert difference(a, {"x": np.array([1.5, np.inf]), "n": np.array([2])}) == 0.5
    assert difference(a, {"x": np.array([1.0, 3.0]), "n": np.array([2])}) == np.inf
    assert difference(a, {"x": np.array([1.0]), "n": np.array([2])}) == np.inf
    assert difference({"x": np.array([0.0])}, {"x": np.array([-0.0])}) > 0  # equal numbers, other bits
    pair = Pair("stage", "name", "what", lambda: {"x": np.array([1.0])}, lambda: {"x": np.array([1.25])}, 0.5, "m")
    assert measured(pair, rounds=1).difference == "2e-01 m"
    assert measured(Pair("stage", "name", "what", pair.with_, pair.with_), rounds=1).difference == EQUAL
