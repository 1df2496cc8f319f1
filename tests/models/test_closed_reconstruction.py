"""Reconstructions as closed meshes, with touch charts of their own or beside them."""

import igl
import numpy as np
import pytest
import trimesh

from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.touch.touched_points import chart_touches
from pipeline.models.observation import Observation
from pipeline.models.reconstruction import Reconstruction, close_reconstruction

BALL = trimesh.creation.icosphere(3, 0.1)
CHART = 0.0174 * chart_square(9)[0].numpy() * [1, -1, 1] + [0, 0, 0.104]  # felt from above, 4 mm over the ball


@pytest.mark.parametrize("own", [True, False])
def test_closed_mesh_passes_through_the_touch_charts(own):
    vertices, faces = np.asarray(BALL.vertices), np.asarray(BALL.faces)
    whole = Reconstruction(vertices, faces, vision=len(vertices), position=np.arange(len(vertices)), side=9)
    parts = Reconstruction(
        np.concatenate([vertices, CHART]),
        np.concatenate([faces, len(vertices) + chart_square(9)[1].numpy()]),
        vision=len(vertices),
        position=whole.position,
        side=9,
    )
    given = Observation(None, chart_touches(np.stack([CHART + 0.1, CHART]), np.array([False, True])))
    mesh = trimesh.Trimesh(*(close_reconstruction(parts, 64) if own else close_reconstruction(whole, 64, given)), process=False)
    assert mesh.is_watertight
    assert np.sqrt(igl.point_mesh_squared_distance(CHART, mesh.vertices, mesh.faces)[0]).max() <= 5e-4
    assert close_reconstruction(whole, 64)[0][:, 2].max() < 0.1035
