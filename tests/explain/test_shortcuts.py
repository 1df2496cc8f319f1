"""What is left out changes nothing: every shortcut beside the same work without it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch

from benchmarks.tradeoff import pairs_data, pairs_learning
from benchmarks.tradeoff.pairs import EQUAL, Pair, Results, difference
from benchmarks.tradeoff.shortcuts import measured
from pipeline.kernels.geometry.exterior_sampling import EscapeTest
from pipeline.kernels.hand.distance import DistanceField
from pipeline.kernels.metrics import distances as metrics
from pipeline.kernels.metrics.chamfer import Target
from pipeline.kernels.networks import touch_losses, zero_neighbour
from pipeline.kernels.networks.deformation import DeformationNetwork
from pipeline.kernels.networks.encoder import ImageEncoder
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch import contact, ray_depth, tactile_image
from stages.render_vision.renderer import Renderer
from stages.simulate_grasps import attempt, stage


def small() -> dict[str, Pair]:
    """Every pair by name, on a small object and with narrow networks."""
    data = pairs_data.Bench(size=1, attempts=8, points=1500, samples=512)
    learning = pairs_learning.Bench(items=1, layers=4, features=24, width=0.25, unet=2, points=2000)
    return {pair.name: pair for pair in (*pairs_data.pairs(data), *pairs_learning.pairs(learning))}


@dataclass(frozen=True)
class Work:
    """What a shortcut spares: calls of a function, or what their arguments hold; and the share of it that is left."""

    owner: Any
    function: str
    left: float
    size: Callable[..., int] = lambda *_: 1

    def done(self, way: Callable[[], Results]) -> tuple[Results, int]:
        """What one way of a pair gives, and how much of this work it did."""
        sizes, genuine = [], getattr(self.owner, self.function)

        def counted(*given: Any, **named: Any) -> Any:
            sizes.append(self.size(*given))
            return genuine(*given, **named)

        with patch.object(self.owner, self.function, counted):
            return way(), sum(sizes)


def entries(matrix: torch.Tensor) -> int:
    return matrix.numel() if matrix.layout == torch.strided else matrix._nnz()


WORK = {
    "sure of side": Work(EscapeTest, "_round", 0.374, lambda sky, points, normals, directions: len(points) * len(directions)),
    "bounds first": Work(DistanceField, "lookup", 0.329, lambda field, points: points[0].size),
    "doubtful balls": Work(DistanceField, "exact", 0.267, lambda field, points: len(points)),
    "gel only": Work(ray_depth, "scan_convert", 155 / 398, lambda faces, width, depth: faces.shape[2]),
    "kept only": Work(attempt, "deepest", 4 / 8),
    "enough attempts": Work(stage, "attempt", 4 / 8),
    "hand kept": Work(Renderer, "add", 29 / 56),
    "prism": Work(ray_depth, "scan_convert", 0.00836, lambda faces, width, depth: faces.shape[2]),
    "untouched reading": Work(tactile_image, "_shade", 1 / 8),
    "points from depth": Work(contact, "sensor_to_world", 1 / 4),
    "fewer loss points": Work(touch_losses, "one_way", 0.267, lambda points, target: len(points)),
    "touched readings": Work(UNet, "forward", 1 / 2, lambda network, readings: len(readings)),
    "fewer samples a step": Work(Target, "nearest", 0.123, lambda target, points: len(points)),
    "encoder once": Work(ImageEncoder, "forward", 1 / 3),
    "touch features once": Work(DeformationNetwork, "_touch_features", 1 / 3),
    "sparse neighbours": Work(torch.Tensor, "__matmul__", 0.0044, lambda matrix, columns: entries(matrix) * columns.shape[1]),
    "what reaches vision": Work(zero_neighbour, "zero_neighbour", 0.582, lambda features, *_: len(features)),
    "each case once": Work(DeformationNetwork, "forward", 1 / 5),
    "one tree a truth": Work(metrics, "cKDTree", 4 / 6),
}


@pytest.fixture(scope="module")
def pairs() -> dict[str, Pair]:
    return small()


@pytest.fixture(autouse=True)
def _one_thread_and_nothing_remembered() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    tactile_image.untouched_image.cache_clear()
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("name", small())
def test_the_results_are_the_same_without_it_for_more_work(pairs: dict[str, Pair], name: str) -> None:
    (ours, little), (plain, much) = (WORK[name].done(way) for way in (pairs[name].with_, pairs[name].without))
    assert any(np.asarray(array).size for array in ours.values())
    assert difference(ours, plain) <= pairs[name].bound
    assert much
    assert little / much == pytest.approx(WORK[name].left, rel=0.15)


def test_a_difference_is_seen_and_a_bound_is_kept_apart_from_equality() -> None:
    a = {"x": np.array([1.0, np.inf]), "n": np.array([2])}
    assert difference(a, {"x": np.array([1.0, np.inf]), "n": np.array([2])}) == 0
    assert difference(a, {"x": np.array([1.5, np.inf]), "n": np.array([2])}) == 0.5
    assert difference(a, {"x": np.array([1.0, 3.0]), "n": np.array([2])}) == np.inf
    assert difference(a, {"x": np.array([1.0]), "n": np.array([2])}) == np.inf
    assert difference({"x": np.array([0.0])}, {"x": np.array([-0.0])}) > 0  # equal numbers, other bits
    pair = Pair("stage", "name", "what", lambda: {"x": np.array([1.0])}, lambda: {"x": np.array([1.25])}, 0.5, "m")
    assert measured(pair, rounds=1).difference == "2e-01 m"
    assert measured(Pair("stage", "name", "what", pair.with_, pair.with_), rounds=1).difference == EQUAL
