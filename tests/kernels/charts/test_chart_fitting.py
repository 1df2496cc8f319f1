"""Chart fitting: against a slow twin, on clouds of every kind, in groups and alone."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pipeline.kernels.charts.chart_fitting import ChartFits, fit_charts
from pipeline.kernels.charts.touch_chart import FitOptions, StopRule, chart_square
from pipeline.kernels.geometry.signed_distance import rms_distance_to_surface
from pipeline.kernels.metrics.surface_sampling import map_to_surface

WIDTH, GEL, PIXELS = 0.01641, 0.0068, 100
HALT = FitOptions(residual_limit=2.5e-4 / WIDTH)
TIGHT = FitOptions(halt=2.3e-4, residual_limit=1e-4 / WIDTH)
NOISE = 6e-5
"""m: below this, 500 points a step jitter more than 4000 do."""
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


def distances(points: Cloud, vertices: Cloud, faces: NDArray[np.int64]) -> Cloud:
    """Compute distances from points to triangles: projections on all planes, edges and corners."""
    best = np.full(len(points), np.inf)
    for a, b, c in vertices[faces]:
        for start, end in ((a, b), (b, c), (c, a)):
            along = np.clip((points - start) @ (end - start) / max(float((end - start) @ (end - start)), 1e-300), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - start - along[:, None] * (end - start), axis=1))
        normal = np.cross(b - a, c - a)
        if normal @ normal > 0:
            above = (points - a) @ normal / (normal @ normal)
            foot = points - above[:, None] * normal
            inside = np.all([np.cross(end - start, foot - start) @ normal >= 0 for start, end in ((a, b), (b, c), (c, a))], axis=0)
            best = np.where(inside, np.minimum(best, np.abs(above) * np.linalg.norm(normal)), best)
    return best


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


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["edge", "flat"])
def test_fit_with_fewer_points_per_step_is_nearly_as_good(kind: str) -> None:
    cloud = np.random.default_rng(2).permutation(CLOUDS[kind])[:2000]
    vertices, steps = twin(cloud, halt=6e-4, samples=4000, cap=1000)
    fits = alone(cloud, FitOptions(learning_rate=SUPPLEMENT.learning_rate))
    faces = chart_square()[1].numpy()
    assert fits.residual[0] <= rms_distance_to_surface(cloud / WIDTH, vertices.numpy(), faces) * WIDTH + NOISE
    assert abs(fits.iterations[0] - steps) <= 0.15 * steps + 10


@pytest.mark.parametrize(("rule", "limit"), [(HALT, 2.5e-4), (TIGHT, 1e-4)], ids=["halt", "tight"])
def test_charts_meet_their_limits_on_clouds_of_each_kind(rule: FitOptions, limit: float) -> None:
    fits = fit_charts([*CLOUDS.values()], WIDTH, generators(len(CLOUDS)), options=rule)
    assert (fits.stop_rule == StopRule.threshold).all(), dict(zip(CLOUDS, fits.stop_rule, strict=True))
    assert (fits.residual <= limit).all(), dict(zip(CLOUDS, fits.residual, strict=True))
    assert (fits.loss < rule.halt).all()
    assert (fits.iterations < rule.max_iterations).all()


@pytest.mark.slow
def test_chart_fits_one_touch_to_50_micrometres() -> None:
    fits = alone(
        CLOUDS["cap"], dataclasses.replace(TIGHT, residual_limit=5e-5 / WIDTH, step_samples=2000, cloud_points=2000, max_iterations=2000)
    )
    assert fits.stop_rule[0] == StopRule.threshold
    assert fits.residual[0] <= 5e-5


def test_final_loss_is_the_chamfer_distance_to_all_points() -> None:
    fits = alone(CLOUDS["edge"], FitOptions())
    vertices, faces = torch.from_numpy(fits.vertices[0] / WIDTH), chart_square()[1].numpy()
    drawn = map_to_surface(vertices, torch.from_numpy(faces), torch.rand(4000, 3, generator=generators(1, 9)[0], dtype=torch.float64))
    pairs = torch.cdist(drawn, torch.from_numpy(CLOUDS["edge"] / WIDTH)) ** 2
    loss = float(pairs.min(dim=0).values.mean() + pairs.min(dim=1).values.mean())
    assert abs(loss - fits.loss[0]) <= 0.05 * loss  # another draw
    assert loss < 1.05 * 6e-4


def test_residual_is_the_distance_to_the_surface() -> None:
    rng = np.random.default_rng(1)
    square, faces = chart_square()
    bent = square.numpy() + rng.normal(scale=0.05, size=(81, 3))
    bent[3], bent[60] = bent[2], bent[61]  # faces without an area
    points = rng.normal(scale=0.4, size=(300, 3))
    expected = float(np.sqrt(np.mean(distances(points, bent, faces.numpy()) ** 2)))
    np.testing.assert_allclose(rms_distance_to_surface(points, bent, faces.numpy()), expected, rtol=1e-12)
    assert rms_distance_to_surface(square.numpy()[:5], square.numpy(), faces.numpy()) == 0


def test_chart_does_not_depend_on_those_beside_it() -> None:
    kinds = [CLOUDS["flat"], CLOUDS["small cap"][:1], CLOUDS["corner"], np.empty((0, 3)), CLOUDS["small cap"]]
    rule = FitOptions(halt=5e-3, max_iterations=110)
    together = fit_charts(kinds, WIDTH, generators(5), options=rule)
    assert len(set(together.iterations)) > 2
    for i, cloud in enumerate(kinds):
        single = alone(cloud, rule, seed=i)
        for field in ("vertices", "residual", "loss", "iterations", "stop_rule"):
            assert getattr(single, field)[0].tobytes() == getattr(together, field)[i].tobytes(), (i, field)


def test_another_seed_gives_another_chart() -> None:
    rule = FitOptions(max_iterations=20)
    assert not np.array_equal(alone(CLOUDS["cap"], rule, 0).vertices, alone(CLOUDS["cap"], rule, 1).vertices)


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


@pytest.mark.parametrize(
    ("clouds", "count", "width", "message"),
    [
        ([POINT, POINT * np.nan], 2, WIDTH, "NaN"),
        ([POINT[:, :2]], 1, WIDTH, r"\(1, 2\)"),
        ([POINT], 2, WIDTH, "1 clouds, 2 generators"),
        ([POINT], 1, 0.0, "width 0"),
    ],
)
def test_fit_charts_rejects_invalid_clouds_and_widths(clouds: list[Cloud], count: int, width: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_charts(clouds, width, generators(count))
