"""Colours of a ball before a ball, seen by a camera that looks along -z from above."""

import numpy as np
import trimesh

from pipeline.kernels.vision.camera import Camera, projection_matrix
from pipeline.kernels.vision.view_transfer import seen_colors

SIDE = 64
CAMERA = Camera(position=(0, 0, 1), rotation=(0, 0, 0), focal=(100, 100), centre=(32, 32), resolution=SIDE)
IMAGE = np.full((SIDE, SIDE, 3), 200, np.uint8)
IMAGE[:, :32], IMAGE[:, 32:] = (255, 0, 0), (0, 0, 255)  # red where x is negative
EVERYWHERE = np.ones((SIDE, SIDE), bool)
NEAR, FAR = (trimesh.creation.icosphere(3, radius).apply_translation([0, 0, z]) for radius, z in ((0.1, 0.2), (0.25, -0.3)))
BALLS = trimesh.util.concatenate([NEAR, FAR])


def looked_up(shown=EVERYWHERE, camera=CAMERA):
    return seen_colors(np.asarray(BALLS.vertices), np.asarray(BALLS.faces), IMAGE, projection_matrix(camera), shown)


def test_vertices_that_face_the_camera_have_the_colour_of_their_pixel():
    colors, seen = looked_up()
    red = BALLS.vertices[:, 0] < -1e-6
    top = np.arange(len(BALLS.vertices)) < len(NEAR.vertices)
    top &= BALLS.vertices[:, 2] > 0.25
    assert seen[top].all()
    assert (colors[seen & red] == [255, 0, 0]).all()
    assert (colors[seen & (BALLS.vertices[:, 0] > 1e-6)] == [0, 0, 255]).all()
    assert (colors[~seen] == 0).all()


def test_vertices_turned_away_or_occluded_are_not_seen():
    _, seen = looked_up()
    assert not seen[: len(NEAR.vertices)][NEAR.vertices[:, 2] < 0.2].any()
    beside = np.linalg.norm(FAR.vertices[:, :2], axis=1) * 0.8 / (1 - FAR.vertices[:, 2])  # where the ray passes the near ball's height
    up = FAR.vertices[:, 2] > -0.2
    assert not seen[len(NEAR.vertices) :][up & (beside < 0.09)].any()
    assert seen[len(NEAR.vertices) :][up & (beside > 0.11)].all()
    assert (up & (beside > 0.11)).any()


def test_unmarked_pixels_and_cameras_that_look_away_give_no_colour():
    assert not looked_up(shown=~EVERYWHERE)[1].any()
    assert not looked_up(camera=CAMERA.model_copy(update={"rotation": (180.0, 0.0, 0.0)}))[1].any()
    assert not looked_up(camera=CAMERA.model_copy(update={"centre": (-1000.0, 32.0)}))[1].any()
