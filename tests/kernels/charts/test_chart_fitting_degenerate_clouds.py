"""Chart fitting to degenerate clouds, and distances to charts of slivers, segments and points."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given

from pipeline.kernels.charts.chart_fitting import ChartFits, fit_charts
from pipeline.kernels.charts.touch_chart import FitOptions, StopRule, chart_square
from pipeline.kernels.geometry.signed_distance import rms_distance_to_surface
from tests.kernels.degenerate_clouds import KINDS, OFFSETS, cloud, soup
from tests.references import exact_distances as exact
from tests.strategies import scales, seeds

WIDTH = 2.0**-6
"""m, about a sensor's: a power of two, so that lengths over it are exact."""
BRIEF = FitOptions(samples=60, step_samples=20, cloud_points=15, max_iterations=4, side=3)
ROUNDING = 1e-13
"""Of the largest coordinate."""
SLIVER = 2e-8
"""Of the largest length, beside slivers of aspect 1e8."""


def generators(count: int) -> list[torch.Generator]:
    return [torch.Generator().manual_seed(i) for i in range(count)]


def fit(points: np.ndarray, width: float = WIDTH) -> ChartFits:
    return fit_charts([points], width, generators(1), options=BRIEF)


@given(seed=seeds, scale=scales, offset=OFFSETS)
def test_residual_is_the_exact_distance_also_beside_slivers(seed: int, scale: float, offset: np.ndarray) -> None:
    vertices, faces = soup(seed)
    vertices = vertices * scale + offset
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.normal(size=(4, 3)) * scale + offset, vertices[faces].mean(axis=1)[:2], vertices[:2]])
    size, reach = np.ptp(vertices, axis=0).max(), np.abs(vertices).max()
    for faced, bound in ((faces[1:], ROUNDING * reach), (faces, ROUNDING * reach + SLIVER * size)):
        true = math.sqrt(exact.mean(exact.squared_to_surface(points, vertices, faced)))
        assert abs(rms_distance_to_surface(points, vertices, faced) - true) <= bound


@given(kind=KINDS, seed=seeds, scale=scales, offset=OFFSETS)
def test_fit_of_any_cloud_is_finite(kind: str, seed: int, scale: float, offset: np.ndarray) -> None:
    """Clouds from a millimetre to 1 km in size, up to 100 m away."""
    points = cloud(kind, seed, scale, offset)
    fits = fit(points)
    assert fits.stop_rule[0] in (StopRule.cap, StopRule.threshold)
    for array in (fits.vertices, fits.residual, fits.loss):
        assert np.isfinite(array).all()
    faces = chart_square(BRIEF.side)[1].numpy()
    true = math.sqrt(exact.mean(exact.squared_to_surface(points, fits.vertices[0], faces)))
    assert abs(fits.residual[0] - true) <= 1e-12 * max(np.abs(points).max(), WIDTH)


@pytest.mark.parametrize("power", [-7, 6])
def test_fit_does_not_depend_on_the_size_of_the_sensor(power: int) -> None:
    points = cloud("spread", 0, WIDTH / 4, np.array([0, 0, 0.005]))
    here, there = fit(points), fit(points * 2.0**power, WIDTH * 2.0**power)
    assert (there.vertices == here.vertices * 2.0**power).all()
    assert there.residual == here.residual * 2.0**power
    assert there.loss == here.loss


@pytest.mark.parametrize("kind", ["one", "identical", "collinear"])
def test_far_points_pull_the_chart_towards_them(kind: str) -> None:
    points = cloud(kind, 1, WIDTH / 100, np.array([1.0, 0, 0]))
    fits = fit(points)
    assert fits.stop_rule.tolist() == [StopRule.cap]
    assert fits.iterations.tolist() == [BRIEF.max_iterations]
    assert (fits.vertices[0, :, 0] >= chart_square(BRIEF.side)[0].numpy()[:, 0] * WIDTH).all()
    assert abs(fits.residual[0] - 1) < WIDTH


@pytest.mark.parametrize(
    ("points", "faces", "message"),
    [
        (np.zeros((0, 3)), [[0, 1, 2]], "0 points and 1 faces"),
        (np.zeros((2, 3)), np.zeros((0, 3), int), "2 points and 0 faces"),
        (np.full((2, 3), np.nan), [[0, 1, 2]], "NaN"),
        (np.full((2, 3), np.inf), [[0, 1, 2]], "infinite"),
    ],
)
def test_rms_distance_rejects_no_points_or_faces(points: np.ndarray, faces: list[list[int]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rms_distance_to_surface(points, np.eye(3), np.asarray(faces))


def test_rms_distance_rejects_infinite_coordinates() -> None:
    with pytest.raises(ValueError, match="vertices are NaN"):
        rms_distance_to_surface(np.zeros((2, 3)), np.full((3, 3), np.nan), np.array([[0, 1, 2]]))


@pytest.mark.parametrize(
    "changes", [{"halt": np.nan}, {"learning_rate": np.inf}, {"samples": 0}, {"cloud_points": 0}, {"residual_limit": 0.0}]
)
def test_fit_options_reject_invalid_limits(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=rf"(?s){next(iter(changes))}\n.*(greater than 0|finite)"):
        FitOptions(**changes)


def test_fit_without_steps_keeps_and_measures_the_square() -> None:
    fits = fit_charts([np.array([[0.0, 0, WIDTH]])], WIDTH, generators(1), options=FitOptions(max_iterations=0))
    assert fits.stop_rule.tolist() == [StopRule.cap]
    assert fits.residual.tolist() == [WIDTH]
    with pytest.raises(ValueError, match=r"(?s)max_iterations\n.*greater than or equal to 0"):
        FitOptions(max_iterations=-1)


@pytest.mark.parametrize("width", [np.inf, np.nan, -1.0])
def test_fit_charts_rejects_invalid_sensor_width(width: float) -> None:
    with pytest.raises(ValueError, match=f"width {width}"):
        fit(np.zeros((5, 3)), width)
