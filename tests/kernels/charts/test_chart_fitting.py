"""Chart fitting: against a slow twin, on clouds of every kind, in groups and alone."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pipeline.kernels.charts.chart_fitting import ChartFits, fit_charts
from pipeline.kernels.charts.touch_chart import FitOptions, chart_square
from schemas.charts import StopRule

WIDTH, GEL, PIXELS = 0.01641, 0.0068, 100
HALT = FitOptions(residual_limit=2.5e-4 / WIDTH)
TIGHT = FitOptions(halt=2.3e-4, residual_limit=1e-4 / WIDTH)
Cloud = NDArray[np.float64]


def pixel_cloud(depth: Callable[[Cloud, Cloud], Cloud]) -> Cloud:
    """Compute the points in the gel from a function of the pixel centres that gives depth, m."""
    centres = ((np.arange(PIXELS) + 0.5) / PIXELS - 0.5) * WIDTH
    x, y = np.meshgrid(centres, centres)
    z = depth(x, y)
    inside = z < GEL
    return np.stack([x[inside], y[inside], z[inside]], axis=1)


def corner(x: Cloud, y: Cloud) -> Cloud:
    """Make a cloud of a cube's corner, pressed in 4 mm deep along its diagonal."""
    axes = np.array([[np.sqrt(2 / 3), 0, np.sqrt(1 / 3)], [-np.sqrt(1 / 6), np.sqrt(1 / 2), np.sqrt(1 / 3)]])
    axes = np.vstack([axes, [-np.sqrt(1 / 6), -np.sqrt(1 / 2), np.sqrt(1 / 3)]])
    return 0.0028 + np.max([-(n[0] * x + n[1] * y) / n[2] for n in axes], axis=0)


CLOUDS = {
    "cap": pixel_cloud(lambda x, y: 0.003 + 0.02 - np.sqrt(0.02**2 - x**2 - y**2)),
    "small cap": pixel_cloud(lambda x, y: 0.0058 + 0.005 - np.sqrt(np.maximum(0.005**2 - x**2 - y**2, 0))),
    "edge": pixel_cloud(lambda x, y: 0.0025 + np.abs(0.6 * x + 0.3 * y)),
    "flat": pixel_cloud(lambda x, y: 0.004 + 0.1 * x),
    "corner": pixel_cloud(corner),
    "noisy": pixel_cloud(lambda x, y: 0.003 + 5 * (x**2 + y**2)) + np.random.default_rng(0).normal(scale=3e-5, size=(10_000, 3)),
}


def generators(count: int, first: int = 0) -> list[torch.Generator]:
    return [torch.Generator().manual_seed(first + i) for i in range(count)]


def alone(cloud: Cloud, rule: FitOptions, seed: int = 0) -> ChartFits:
    return fit_charts([cloud], WIDTH, generators(1, seed), options=rule)


def twin(cloud: Cloud, halt: float, samples: int, cap: int) -> tuple[torch.Tensor, int]:
    """Section 2.3 in a dozen lines: one chart, all pairs, torch's own Adam; in sensor widths."""
    target = torch.from_numpy(cloud / WIDTH)
    square, faces = chart_square()
    vertices = square.clone().requires_grad_()
    adam = torch.optim.Adam([vertices], lr=0.003)
    generator = torch.Generator().manual_seed(0)
    for step in range(cap + 1):
        a, b, c = vertices[faces].unbind(dim=1)
        areas = torch.linalg.cross(b - a, c - a).norm(dim=1).detach()
        uniform = torch.rand(samples, 3, generator=generator, dtype=torch.float64)
        face = torch.searchsorted(areas.cumsum(0), uniform[:, 0] * areas.sum(), right=True)
        root, v = uniform[:, 1:2].sqrt(), uniform[:, 2:]
        drawn = (1 - root) * a[face] + root * (1 - v) * b[face] + root * v * c[face]
        pairs = torch.cdist(drawn, target) ** 2
        loss = pairs.min(dim=0).values.mean() + pairs.min(dim=1).values.mean()
        if loss < halt or step == cap:
            break
        adam.zero_grad()
        loss.backward()
        adam.step()
    return vertices.detach(), step


SUPPLEMENT = FitOptions(step_samples=4000, cloud_points=None, check_every=1, learning_rate=3e-3)
"""Section 2.3 exactly."""


def test_fit_with_the_supplements_options_equals_the_slow_twin() -> None:
    cloud = CLOUDS["cap"][::23]
    rule = dataclasses.replace(SUPPLEMENT, samples=300, step_samples=300, halt=0.02, max_iterations=60)
    fits = alone(cloud, rule)
    vertices, steps = twin(cloud, halt=0.02, samples=300, cap=60)
    assert 0 < steps < 60
    assert fits.iterations[0] == steps
    assert fits.stop_rule[0] == StopRule.threshold
    np.testing.assert_allclose(fits.vertices[0] / WIDTH, vertices.numpy(), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("rule", "limit"), [(HALT, 2.5e-4), (TIGHT, 1e-4)], ids=["halt", "tight"])
def test_charts_meet_their_limits_on_clouds_of_each_kind(rule: FitOptions, limit: float) -> None:
    fits = fit_charts([*CLOUDS.values()], WIDTH, generators(len(CLOUDS)), options=rule)
    assert (fits.stop_rule == StopRule.threshold).all(), dict(zip(CLOUDS, fits.stop_rule, strict=True))
    assert (fits.residual <= limit).all(), dict(zip(CLOUDS, fits.residual, strict=True))
    assert (fits.loss < rule.halt).all()
    assert (fits.iterations < rule.max_iterations).all()


def test_chart_does_not_depend_on_those_beside_it() -> None:
    kinds = [CLOUDS["flat"], CLOUDS["small cap"][:1], CLOUDS["corner"], np.empty((0, 3)), CLOUDS["small cap"]]
    rule = FitOptions(halt=5e-3, max_iterations=110)
    together = fit_charts(kinds, WIDTH, generators(5), options=rule)
    assert len(set(together.iterations)) > 2
    for i, cloud in enumerate(kinds):
        single = alone(cloud, rule, seed=i)
        for field in ("vertices", "residual", "loss", "iterations", "stop_rule"):
            assert getattr(single, field)[0].tobytes() == getattr(together, field)[i].tobytes(), (i, field)


POINT = np.array([[0.002, -0.003, 0.005]])
FEW = {
    "one": POINT,
    "identical": np.repeat(POINT, 500, axis=0),
    "three": POINT + np.array([[0, 0, 0], [4e-4, 0, 0], [0, 3e-4, 1e-4]]),
    "collinear": POINT + np.linspace(0, 5e-3, 40)[:, None] * np.array([[1.0, 0.5, -0.2]]),
    "far apart": np.array([[-8e-3, -8e-3, 1e-3], [8e-3, 8e-3, 6e-3]]),
}


@pytest.mark.parametrize("rule", [HALT, pytest.param(TIGHT, marks=pytest.mark.slow)], ids=["halt", "tight"])
def test_charts_of_few_points_are_finite_and_near(rule: FitOptions) -> None:
    fits = fit_charts([*FEW.values()], WIDTH, generators(len(FEW)), options=rule)
    assert set(fits.stop_rule) <= {StopRule.threshold, StopRule.cap}
    for array in (fits.vertices, fits.residual, fits.loss):
        assert np.isfinite(array).all()
    assert (fits.residual <= 2.5e-4).all(), dict(zip(FEW, fits.residual, strict=True))


def test_empty_cloud_keeps_the_square() -> None:
    fits = alone(np.empty((0, 3)), FitOptions())
    assert fits.stop_rule.tolist() == [StopRule.too_few_points]
    assert fits.residual.tolist() == fits.loss.tolist() == fits.iterations.tolist() == [0]
    np.testing.assert_array_equal(fits.vertices[0], chart_square()[0].numpy() * WIDTH)
    assert fit_charts([], WIDTH, []).vertices.shape == (0, 81, 3)
    oblong = fit_charts([np.empty((0, 3))], WIDTH, generators(1), aspect=1.5)
    np.testing.assert_array_equal(oblong.vertices[0], chart_square(aspect=1.5)[0].numpy() * WIDTH)


def test_iteration_limit_is_recorded_with_the_charts_state() -> None:
    fits = alone(CLOUDS["cap"], FitOptions(max_iterations=7))
    assert fits.stop_rule.tolist() == [StopRule.cap]
    assert fits.iterations.tolist() == [7]
    assert 6e-4 < fits.loss[0] < 1
    assert fits.residual[0] > 1e-3


def test_chart_without_area_is_collapsed(monkeypatch: pytest.MonkeyPatch) -> None:
    square = torch.zeros(81, 3, dtype=torch.float64)
    monkeypatch.setattr("pipeline.kernels.charts.chart_fitting.chart_square", lambda side, aspect: (square, chart_square(side, aspect)[1]))
    fits = alone(POINT, FitOptions())
    assert fits.stop_rule.tolist() == [StopRule.collapsed]
    assert np.isfinite(fits.residual).all()


def test_fit_without_steps_keeps_and_measures_the_square() -> None:
    fits = alone(np.array([[0.0, 0, WIDTH]]), FitOptions(max_iterations=0))
    assert fits.stop_rule.tolist() == [StopRule.cap]
    assert fits.residual.tolist() == [WIDTH]


@pytest.mark.parametrize(
    ("clouds", "named"),
    [
        ([POINT, POINT * np.nan], "NaN"),
        ([POINT[:, :2]], r"\(1, 2\)"),
    ],
)
def test_fit_charts_rejects_invalid_clouds(clouds: list[Cloud], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        fit_charts(clouds, WIDTH, generators(len(clouds)))
