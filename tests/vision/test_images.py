import os
import subprocess
import sys

import numpy as np
import pytest

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.camera import Camera, camera_pose, look_at, project_points, projection_matrix
from pipeline.kernels.vision.labels import Label
from pipeline.kernels.vision.primitives import flatten_texture, shrink_texture
from stages.render_vision.renderer import RenderedImage, Renderer
from tests.vision.shapes import CENTRE, HERE, SCENE, ball, box, card, half_turned, turned_over
from tests.vision.twins import cast


def seen(renderer: Renderer, *meshes: Mesh, camera: Camera | None = None) -> RenderedImage:
    """The first mesh is the object, the others are the hand."""
    parts = [renderer.add(mesh, Label.HAND if k else Label.OBJECT) for k, mesh in enumerate(meshes)]
    view = renderer.render([(part, HERE) for part in parts], camera)
    for part in parts:
        renderer.remove(part)
    return view


def linear_to_srgb(value: np.ndarray) -> np.ndarray:
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def srgb_to_linear(value: np.ndarray) -> np.ndarray:
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def diffuse_light(normal: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(3,) what a white surface shows of constant light and lamp, highlight apart, linear."""
    to_lamp = np.array(SCENE.lamp.position) - at
    distance = np.linalg.norm(to_lamp)
    lamp = np.array(SCENE.lamp.color) * SCENE.lamp.intensity / distance**2
    return np.array(SCENE.ambient) + lamp * max(normal @ to_lamp / distance, 0)


def test_an_empty_image_is_the_background_to_the_bit(renderer) -> None:
    view = renderer.render([])
    assert (view.rgb == np.round(np.array(SCENE.background) * 255).astype(np.uint8)).all()
    assert (view.segmentation == Label.BACKGROUND).all()
    assert view.rgb.shape == (256, 256, 3)
    assert view.rgb.dtype == view.segmentation.dtype == np.uint8


@pytest.mark.parametrize("resolution", [256, 97])
def test_segmentation_is_a_ray_cast_at_pixel_centres(renderer, resolution) -> None:
    camera = SCENE.camera.with_resolution(resolution)
    thing, hand = half_turned(ball(0.17)), box((0.1, 0.5, 0.05))
    truth = cast(camera, thing, hand)
    got = seen(renderer, thing, hand, camera=camera).segmentation
    differing = (truth != got).sum()
    assert set(np.unique(truth)) == {0, 1, 2}
    assert differing <= 2, f"{differing} pixels differ: silhouettes may differ by rounding in a pixel or two, not more"


def test_projected_points_lie_where_the_segmentation_shows_them(renderer) -> None:
    matrix = projection_matrix(SCENE.camera)
    for offset in ([0.0, 0.0, 0.0], [0.05, -0.2, 0.1], [-0.1, 0.15, -0.2]):
        small = ball(0.02)
        small = Mesh(small.vertices + offset, small.faces, small.look)
        rows, cols = np.nonzero(seen(renderer, small).segmentation)
        centre = np.array([cols.mean() + 0.5, rows.mean() + 0.5])
        assert centre == pytest.approx(project_points(matrix, CENTRE + offset), abs=0.15)  # half a pixel would be a wrong convention


def test_a_plane_shows_the_shaders_closed_form(renderer) -> None:
    mesh = card(0.05, None, (200, 120, 40, 255))
    rgb = seen(renderer, mesh).rgb[128, 128] / 255
    backward = camera_pose(SCENE.camera)[:3, 2]
    albedo = srgb_to_linear(np.array([200, 120, 40]) / 255)
    matt = linear_to_srgb(albedo * diffuse_light(backward, CENTRE))
    assert (rgb >= matt - 1 / 255).all()
    assert (srgb_to_linear(rgb) - srgb_to_linear(matt) < 0.03).all()  # the highlight, far from the mirror direction


def test_textures_are_the_right_way_up_and_keep_their_colours(renderer) -> None:
    corners = {"red": (255, 0, 0), "green": (0, 255, 0), "blue": (0, 0, 255), "yellow": (255, 255, 0)}
    texture = np.full((31, 33, 4), 255, np.uint8)  # odd sizes: rows are no multiple of four bytes
    texture[:16, :17, :3], texture[:16, 17:, :3] = corners["red"], corners["green"]
    texture[16:, :17, :3], texture[16:, 17:, :3] = corners["blue"], corners["yellow"]
    rgb = seen(renderer, card(0.2, texture)).rgb
    centre = project_points(projection_matrix(SCENE.camera), CENTRE).round().astype(int)
    for (row, col), color in zip(((-30, -30), (-30, 30), (30, -30), (30, 30)), corners.values(), strict=True):
        pixel = rgb[centre[1] + row, centre[0] + col].astype(int)
        lit = np.array(color) > 0
        assert pixel[lit].min() > 130, (row, col, pixel)
        assert pixel[~lit].max() < 60, (row, col, pixel)


def test_inside_out_and_badly_wound_meshes_look_like_good_ones(renderer) -> None:
    good = seen(renderer, ball())
    for bad in (turned_over(ball()), half_turned(ball())):
        view = seen(renderer, bad)
        assert (view.segmentation == good.segmentation).all()
        assert np.abs(view.rgb.astype(int) - good.rgb.astype(int)).max() <= 1


def test_an_open_mesh_shows_its_inside_lit(renderer) -> None:
    whole = box(turn=(0, 0, 0))
    towards = np.array(SCENE.camera.position) - CENTRE
    normals = np.cross(*(whole.triangles[:, k] - whole.triangles[:, 0] for k in (1, 2)))
    far_side = Mesh(whole.vertices, whole.faces[normals @ towards < 0], Look.plain(8, 6))
    view = seen(renderer, far_side)
    shown = view.rgb[view.segmentation == Label.OBJECT]
    assert len(shown) > 5000
    assert shown.min() > 80  # constant light alone gives 95
    assert len(np.unique(shown[:, 0])) > 3  # and the lamp more to some


def test_what_is_transparent_is_drawn_opaque_in_its_base_colour(renderer) -> None:
    solid = seen(renderer, card(0.1, None, (200, 30, 30, 255)))
    glass = seen(renderer, card(0.1, None, (200, 30, 30, 0)))
    assert (solid.rgb == glass.rgb).all()
    assert (glass.segmentation == solid.segmentation).all()
    hole = np.zeros((8, 8, 4), np.uint8)
    assert (seen(renderer, card(0.1, hole, (200, 30, 30, 255))).rgb == solid.rgb).all()
    assert (flatten_texture(np.array([[[100, 0, 0, 128]]], np.uint8)) == [[[177, 127, 127, 255]]]).all()


def test_materials_paint_their_own_faces(renderer) -> None:
    mesh = ball()
    right = camera_pose(SCENE.camera)[:3, 0]
    side = (mesh.triangles.mean(1) - CENTRE) @ right > 0
    look = Look(
        uv=np.zeros((len(mesh.vertices), 2), np.float32),
        face_material=side.astype(np.int32),
        base_color=np.array([[220, 20, 20, 255], [20, 20, 220, 255]], np.uint8),
        material_texture=np.array([-1, -1], np.int32),
    )
    rgb = seen(renderer, Mesh(mesh.vertices, mesh.faces, look)).rgb.astype(int)
    assert rgb[128, 90, 0] > rgb[128, 90, 2] + 50
    assert rgb[128, 165, 2] > rgb[128, 165, 0] + 50


def test_textures_are_shrunk_to_what_every_card_takes() -> None:
    assert shrink_texture(np.full((3, 5000, 4), 7, np.uint8)).shape == (1, 1667, 4)
    small = np.zeros((20, 30, 4), np.uint8)
    assert shrink_texture(small) is small


def test_parts_move_and_those_not_named_are_not_shown(renderer) -> None:
    first, second = renderer.add(ball(0.05), Label.OBJECT), renderer.add(ball(0.05), Label.HAND)
    aside = np.eye(4)
    aside[:3, 3] = 0.15 * camera_pose(SCENE.camera)[:3, 0]
    both = renderer.render([(first, HERE), (second, aside)])
    alone = renderer.render([(first, HERE)])
    assert set(np.unique(both.segmentation)) == {0, 1, 2}
    assert set(np.unique(alone.segmentation)) == {0, 1}
    assert np.nonzero(both.segmentation == 2)[1].mean() > np.nonzero(both.segmentation == 1)[1].mean() + 40
    for part in (first, second):
        renderer.remove(part)


def test_renderers_do_not_disturb_each_other(renderer) -> None:
    before = seen(renderer, ball())
    with Renderer(SCENE, 64) as other:
        assert seen(other, ball()).rgb.shape == (64, 64, 3)
    other.close()
    assert (seen(renderer, ball()).rgb == before.rgb).all()


def test_another_camera_looks_and_the_first_comes_back(renderer) -> None:
    before = seen(renderer, box())
    camera = look_at(SCENE.camera.with_resolution(96), (-1.0, 0.3, 0.2), (0.0, 0.0, 0.6))
    view = seen(renderer, box(), camera=camera)
    assert view.rgb.shape == (96, 96, 3)
    assert ((view.segmentation > 0) != (cast(camera, box()) > 0)).sum() <= 2
    assert (seen(renderer, box()).rgb == before.rgb).all()


PROCESS = """
import hashlib, sys, numpy as np
from tests.vision.shapes import SCENE, HERE, ball, box, card, half_turned
from stages.render_vision.renderer import Renderer
from pipeline.kernels.vision.labels import Label
texture = np.random.default_rng(1).integers(0, 256, (50, 70, 4)).astype(np.uint8)
digest = hashlib.sha256()
with Renderer(SCENE) as renderer:
    # Two copies of one ball in different labels: which of two coincident faces shows must not change from run to run.
    meshes = [(half_turned(ball()), Label.OBJECT), (ball(color=(9, 9, 200)), Label.HAND), (box(), Label.OBJECT)]
    meshes.append((card(0.2, texture), Label.OBJECT))
    parts = [(renderer.add(mesh, label), HERE) for mesh, label in meshes]
    for _ in range(2):
        view = renderer.render(parts)
        digest.update(view.rgb.tobytes() + view.segmentation.tobytes())
print(digest.hexdigest())
"""


def run(code: str, **variables: str) -> str:
    """What a fresh process prints for `code`."""
    environment = {
        name: value for name, value in os.environ.items() if name not in ("PYOPENGL_PLATFORM", "LP_NATIVE_VECTOR_WIDTH")
    } | variables
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout


def test_images_are_the_same_to_the_bit_in_every_process_whatever_mesa_may_use_of_the_processor() -> None:
    assert run(PROCESS, PYTHONHASHSEED="1") == run(
        PROCESS, PYTHONHASHSEED="2", LP_NATIVE_VECTOR_WIDTH="512", GALLIUM_OVERRIDE_CPU_CAPS="avx"
    )


def test_without_opengl_the_error_names_the_packages_and_the_environment_is_left_as_it_was() -> None:
    code = """
import os
from tests.vision.shapes import SCENE
from stages.render_vision.opengl_context import NoOpenGL
from stages.render_vision.renderer import Renderer
try:
    Renderer(SCENE)
except NoOpenGL as error:
    print(error)
print("PYOPENGL_PLATFORM" in os.environ or "LP_NATIVE_VECTOR_WIDTH" in os.environ)
"""
    without = run(code, __EGL_VENDOR_LIBRARY_DIRS="/nowhere")  # libglvnd finds no driver there
    assert "apt-get install libegl1 libgl1 libxrender1 libgl1-mesa-dri" in without
    assert without.endswith("False\n")
    assert run(code) == "False\n"


def resident() -> float:
    """Megabytes of this process in memory."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.parametrize("objects", [60, pytest.param(300, marks=pytest.mark.slow)])
def test_memory_stays_flat_over_objects(renderer, objects) -> None:
    rng = np.random.default_rng(0)

    def one() -> None:
        texture = rng.integers(0, 256, (500, 500, 4)).astype(np.uint8)  # 1 MB: kept by OpenGL, fifty of them would show
        mesh = ball(subdivisions=4)
        look = Look(
            uv=rng.random((len(mesh.vertices), 2)).astype(np.float32),
            face_material=np.zeros(len(mesh.faces), np.int32),
            base_color=np.full((1, 4), 255, np.uint8),
            material_texture=np.zeros(1, np.int32),
            textures=(texture,),
        )
        seen(renderer, Mesh(mesh.vertices, mesh.faces, look), camera=SCENE.camera.with_resolution(64))

    for _ in range(20):
        one()
    before = resident()
    for _ in range(objects):
        one()
    assert resident() - before < 30  # the textures of 60 objects kept would be 60
