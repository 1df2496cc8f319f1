"""Every shortcut gives the same results as the same work without it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch

from benchmarks.tradeoff import shortcuts_data, shortcuts_learning
from benchmarks.tradeoff.shortcut import Results, Shortcut
from benchmarks.tradeoff.shortcuts import EQUAL, difference, measure
from pipeline.kernels.geometry.exterior_sampling import EscapeTest
from pipeline.kernels.hand.distance_field import DistanceField
from pipeline.kernels.metrics.chamfer import SearchCloud
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.touch import ray_depth
from stages.simulate_grasps.grasp_search import GraspSearch


def small() -> dict[str, Shortcut]:
    """Every shortcut by name, on a small object and with narrow networks."""
    data = shortcuts_data.Bench(size=1, attempts=24, points=1500, samples=512)
    learning = shortcuts_learning.Bench(items=1, layers=4, features=24)
    return {one.name: one for one in (*shortcuts_data.shortcuts(data), *shortcuts_learning.shortcuts(learning))}


@dataclass(frozen=True)
class Work:
    """What a shortcut spares: calls of a function, or what their arguments hold."""

    owner: Any
    function: str
    size: Callable[..., int] = lambda *_: 1

    def done(self, way: Callable[[], Results]) -> tuple[Results, int]:
        """Return the results of one way of a pair, and how much of this work it did."""
        sizes, genuine = [], getattr(self.owner, self.function)

        def counted(*given: Any, **named: Any) -> Any:
            sizes.append(self.size(*given))
            return genuine(*given, **named)

        with patch.object(self.owner, self.function, counted):
            return way(), sum(sizes)


def entries(matrix: torch.Tensor) -> int:
    return matrix.numel() if matrix.layout == torch.strided else matrix._nnz()


WORK = {
    "sure of side": Work(EscapeTest, "_escape", lambda test, points, directions: len(points) * len(directions)),
    "doubtful spheres": Work(DistanceField, "exact", lambda field, points: len(points)),
    "enough attempts": Work(GraspSearch, "attempt"),
    "prism": Work(ray_depth, "scan_convert", lambda faces, *_: faces.shape[2]),
    "fewer samples per step": Work(SearchCloud, "nearest", lambda target, points: len(points)),
    "sparse neighbours": Work(torch.Tensor, "__matmul__", lambda matrix, columns: entries(matrix) * columns.shape[1]),
    "each case once": Work(DeformationNetwork, "forward"),
}
"""The work that each shortcut must do less of."""


@pytest.fixture(scope="module")
def shortcuts() -> dict[str, Shortcut]:
    return small()


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("name", small())
def test_shortcut_gives_the_same_results_with_less_work(shortcuts: dict[str, Shortcut], name: str) -> None:
    shortcut = shortcuts[name]
    (ours, little), (plain, much) = (WORK[name].done(way) for way in (shortcut.with_, shortcut.without))
    assert any(np.asarray(array).size for array in ours.values())
    assert difference(ours, plain) <= shortcut.bound
    assert little < much


def test_difference_is_greatest_number_and_zero_only_for_equal_bits() -> None:
    a = {"x": np.array([1.0, np.inf]), "n": np.array([2])}
    assert difference(a, {"x": np.array([1.0, np.inf]), "n": np.array([2])}) == 0
    assert difference(a, {"x": np.array([1.5, np.inf]), "n": np.array([2])}) == 0.5
    assert difference(a, {"x": np.array([1.0, 3.0]), "n": np.array([2])}) == np.inf
    assert difference(a, {"x": np.array([1.0]), "n": np.array([2])}) == np.inf
    assert difference({"x": np.array([0.0])}, {"x": np.array([-0.0])}) > 0  # equal numbers, other bits


def test_measured_shortcut_says_how_far_its_results_are_apart() -> None:
    shortcut = Shortcut("stage", "name", "what", lambda: {"x": np.array([1.0])}, lambda: {"x": np.array([1.25])}, 0.5, "m")
    assert measure(shortcut, turns=1)["difference"] == "2e-01 m"
    assert measure(Shortcut("stage", "name", "what", shortcut.with_, shortcut.with_), turns=1)["difference"] == EQUAL
