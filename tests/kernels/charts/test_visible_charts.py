"""Charts of a visible surface: on planes and balls in closed form, with noise, and none without a smooth surface."""

import numpy as np
import pytest

from pipeline.kernels.charts.visible_charts import WIDTH, visible_charts
from pipeline.kernels.touch.touched_points import chart_normals

ROWS, COLS, FOCAL, SIDE = 90, 120, 300.0, 5
INTRINSIC = np.array([[FOCAL, 0, COLS / 2], [0, FOCAL, ROWS / 2], [0, 0, 1]])
RAYS = np.stack(
    [*np.meshgrid((np.arange(COLS) + 0.5 - COLS / 2) / FOCAL, (np.arange(ROWS) + 0.5 - ROWS / 2) / FOCAL), np.ones((ROWS, COLS))], axis=-1
)
CENTRE, RADIUS = np.array([0.02, -0.01, 0.6]), 0.08
EVERYWHERE = np.full((ROWS, COLS), True)


def plane(normal: tuple[float, float, float], away: float) -> np.ndarray:
    """Compute the depth of the plane normal · x = away along each ray."""
    return away / (RAYS @ np.array(normal))


def ball() -> np.ndarray:
    """Compute the depth of the ball; NaN beside it."""
    along, squared = RAYS @ CENTRE, (RAYS**2).sum(axis=-1)
    with np.errstate(invalid="ignore"):
        return (along - np.sqrt(along**2 - squared * (CENTRE @ CENTRE - RADIUS**2))) / squared


def test_charts_lie_on_a_tilted_plane_and_face_the_camera():
    normal = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    charts = visible_charts(plane(tuple(normal), 0.5), EVERYWHERE, INTRINSIC, SIDE)
    assert charts.shape[1:] == (SIDE**2, 3)
    assert len(charts) > 20
    np.testing.assert_allclose(charts @ normal, 0.5, atol=1e-4)  # its depth is no quadric of the pixel, but almost
    np.testing.assert_allclose(chart_normals(charts), np.broadcast_to(-normal, charts.shape), atol=0.02)
    sides = np.ptp(charts[:, :, 0], axis=1)
    assert (np.abs(sides - WIDTH) < 0.3 * WIDTH).all()


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_charts_are_as_large_in_proportion_to_any_object(scale):
    charts = visible_charts(plane((0, 0, 1), 0.5), EVERYWHERE, INTRINSIC, SIDE, scale)
    np.testing.assert_allclose(np.ptp(charts[:, :, 0], axis=1), WIDTH / scale, rtol=0.15)


def test_charts_lie_on_the_visible_part_of_a_ball():
    depth = ball()
    charts = visible_charts(depth, np.isfinite(depth), INTRINSIC, SIDE)
    offset = charts - CENTRE
    np.testing.assert_allclose(np.linalg.norm(offset, axis=-1), RADIUS, atol=1e-3)
    normals = chart_normals(charts)
    assert ((normals * offset).sum(axis=-1) > 0.9 * RADIUS).all()
    assert len(charts) > 12


def test_edge_between_two_depths_has_no_chart():
    depth = np.where(np.arange(COLS) < COLS // 2 + 3, 0.5, 0.6) * np.ones((ROWS, 1))
    charts = visible_charts(depth, EVERYWHERE, INTRINSIC, SIDE)
    assert len(charts)
    assert (np.minimum(np.abs(charts[..., 2] - 0.5), np.abs(charts[..., 2] - 0.6)) < 1e-6).all()


@pytest.mark.parametrize(
    ("depth", "shown"),
    [(np.full((ROWS, COLS), np.nan), EVERYWHERE), (plane((0, 0, 1), 0.5), ~EVERYWHERE), (plane((0, -0.995, 0.1), 0.1), EVERYWHERE)],
    ids=["nothing measured", "no object", "seen too flatly"],
)
def test_empty_or_invalid_depth_gives_no_charts(depth, shown):
    with np.errstate(invalid="ignore"):
        charts = visible_charts(np.where(depth > 0, depth, np.nan), shown, INTRINSIC, SIDE)
    assert charts.shape == (0, SIDE**2, 3)
