"""Images of nothing and of everything, in black, white and too bright a light."""

import numpy as np
import pytest

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.camera import Camera
from pipeline.kernels.vision.scene import Label
from stages.render_vision.renderer import CLOSE_PLANE, FAR_PLANE, RenderedImage, Renderer
from tests.kernels.vision.shapes import HERE, SCENE

DOWN = Camera(position=(0.0, 0.0, 1.0), rotation=(0.0, 0.0, 0.0), focal=(64.0, 64.0), centre=(16.5, 16.5), resolution=33)
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
AMBIENT = np.array(SCENE.ambient)


def floor(color: tuple[int, int, int] = (255, 255, 255), scale: float = 1.0, at: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    return Mesh(SQUARE * scale + at, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Look.plain(4, 2, color))


def seen(renderer: Renderer, mesh: Mesh, camera: Camera = DOWN, lamp: tuple[float, float, float] = (0, 0, 1e3)) -> RenderedImage:
    part = renderer.add(mesh, Label.OBJECT)
    try:
        return renderer.render([(part, HERE)], camera, lamp)
    finally:
        renderer.remove(part)


def srgb(light: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055))


def test_light_is_constant_without_a_lamp_and_clipped_to_white_in_excess(renderer) -> None:
    """A lamp that is far away, on the surface or behind it lights nothing; a millimetre above the floor it makes it white."""
    for color, albedo in (((0, 0, 0), 0.0), ((255, 255, 255), 1.0)):
        assert np.abs(seen(renderer, floor(color)).rgb.astype(int) - srgb(albedo * AMBIENT)).max() <= 1
    for height in (0.0, -1e-3):
        assert np.abs(seen(renderer, floor(), lamp=(0.0, 0.0, height)).rgb.astype(int) - srgb(AMBIENT)).max() <= 1
    rgb = seen(renderer, floor(), lamp=(0.0, 0.0, 1e-3)).rgb.astype(int)
    assert (rgb[16, 16] == 255).all()
    assert (np.diff(rgb[16, 16:, 0]) <= 1).all()


def test_mesh_without_faces_leaves_the_background(renderer) -> None:
    view = seen(renderer, Mesh.bare(np.zeros((0, 3)), np.zeros((0, 3))))
    assert (view.segmentation == Label.BACKGROUND).all()
    assert (view.rgb == np.round(np.array(SCENE.background) * 255).astype(np.uint8)).all()


def test_objects_larger_than_the_image_and_smaller_than_a_pixel(renderer) -> None:
    assert (seen(renderer, floor(scale=10)).segmentation == Label.OBJECT).all()
    assert (seen(renderer, floor(scale=1e-6, at=(0.005, 0.005, 0))).segmentation == Label.BACKGROUND).all()
    lone = seen(renderer, floor(scale=1e-3)).segmentation  # 0.13 pixels wide, over the middle one's centre
    assert np.argwhere(lone == Label.OBJECT).tolist() == [[16, 16]]


@pytest.mark.parametrize(
    ("depth", "shown"),
    [(0.99 * CLOSE_PLANE, False), (1.01 * CLOSE_PLANE, True), (0.03, True), (0.99 * FAR_PLANE, True), (1.01 * FAR_PLANE, False)],
)
def test_surfaces_outside_near_and_far_plane_are_not_drawn(renderer, depth, shown) -> None:
    assert (seen(renderer, floor(scale=100, at=(0, 0, 1 - depth))).segmentation == Label.OBJECT).all() == shown


@pytest.mark.parametrize("away", [9.0, 30.0, 100.0])
def test_distant_camera_with_a_long_lens_shows_the_surroundings_of_the_origin(renderer, away) -> None:
    camera = DOWN.model_copy(update={"position": (0.0, 0.0, away), "focal": (64 * away, 64 * away)})
    view = seen(renderer, floor(scale=0.1), camera)
    assert (view.segmentation == seen(renderer, floor(scale=0.1)).segmentation).all()
    assert view.depth[16, 16] == pytest.approx(away, rel=1e-4)


def test_degenerate_and_duplicate_faces_change_no_pixel(renderer) -> None:
    plain = floor((200, 120, 40), scale=0.1)
    faces = np.vstack([plain.faces, plain.faces[:, ::-1], [[0, 0, 1], [2, 2, 2]]]).astype(np.int32)
    odd = seen(renderer, Mesh(plain.vertices, faces, Look.plain(4, len(faces), (200, 120, 40))))
    even = seen(renderer, plain)
    np.testing.assert_array_equal(odd.rgb, even.rgb)
    np.testing.assert_array_equal(odd.segmentation, even.segmentation)
