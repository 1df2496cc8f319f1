"""Parts of surfaces near touches and hidden from cameras, and baselines that learn nothing, against closed forms."""

import io

import numpy as np
import pytest
import trimesh
from rich.console import Console

from pipeline.console import cell_text
from pipeline.engine.make import plans
from pipeline.engine.plan import Request
from pipeline.kernels.geometry.exterior_sampling import RayScene
from pipeline.kernels.geometry.transforms import unit_vectors
from pipeline.kernels.metrics.cloud_distances import cloud_distances, sampling_distance
from pipeline.kernels.vision.camera import Camera, look_at, project_points, projection_matrix
from pipeline.kernels.vision.scene import Label
from pipeline.tables.evaluation_tables import evaluation_tables
from stages.evaluate.evaluation_files import read_figures
from stages.evaluate.shape_baselines import extrude_silhouette, mirrored, smooth_surface
from stages.evaluate.stage import Evaluate, EvaluationSettings
from stages.evaluate.surface_parts import LABELS, hidden_points
from tests.stages import ball_dataset as spheres

CENTRE = np.array([0.0, 0.0, 0.6])
RADIUS = 0.05


def camera_at(distance: float, pixels: float = 100.0) -> np.ndarray:
    """Look along -x at the centre, on which a length of the radius is `pixels` long."""
    focal = pixels * distance / RADIUS
    camera = Camera(name="camera", position=(1, 0, 0), rotation=(0, 0, 0), focal=(focal, focal), centre=(128, 128), resolution=256)
    return projection_matrix(look_at(camera, (distance, 0.0, 0.6), (0.0, 0.0, 0.6)))


def sphere_points(count: int = 5000) -> np.ndarray:
    return CENTRE + RADIUS * unit_vectors(np.random.default_rng(0).normal(size=(count, 3)))


def sphere_scene() -> RayScene:
    ball = trimesh.creation.icosphere(5, RADIUS)
    return RayScene(np.asarray(ball.vertices) + CENTRE, np.asarray(ball.faces))


@pytest.mark.parametrize("distance", [0.1, 0.3, 5.0])
def test_camera_sees_the_cap_of_a_sphere(distance):
    """A cap of height r (1 - r/d) is visible: a share (1 - r/d) / 2 of the area."""
    hidden = hidden_points(sphere_points(), sphere_scene(), camera_at(distance), np.full((256, 256), Label.OBJECT, np.uint8))
    assert 1 - hidden.mean() == pytest.approx((1 - RADIUS / distance) / 2, abs=0.02)


def test_hand_and_image_edge_hide_what_is_behind_them():
    shown = np.full((256, 256), Label.OBJECT, np.uint8)
    shown[:128] = Label.HAND
    points = sphere_points()
    hidden = hidden_points(points, sphere_scene(), camera_at(5.0), shown)
    visible = points[~hidden]
    assert hidden.mean() == pytest.approx(0.75, abs=0.02)
    assert (visible[:, 2] <= 0.6).all()  # the image's rows go down
    cut = hidden_points(points, sphere_scene(), camera_at(5.0), shown[128:, :128])
    assert (project_points(camera_at(5.0), points[~cut]) < 128).all()


def test_surface_before_another_one_hides_it():
    """A plate of twice the size before a plate hides it; both sides of the front one are seen through no wall."""
    plate = np.array([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1.0]])
    vertices = np.concatenate([CENTRE + RADIUS * plate, CENTRE + [0.1, 0, 0] + 2 * RADIUS * plate])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    points = np.array([CENTRE + [0, 0.01, 0], CENTRE + [0.1, 0.01, 0]])
    shown = np.full((256, 256), Label.OBJECT, np.uint8)
    assert hidden_points(points, RayScene(vertices, faces), camera_at(5.0), shown).tolist() == [True, False]


def test_shifted_sphere_errs_as_much_on_the_hidden_half():
    """A shift by s towards the camera moves the surface by s cos at an angle from it, and a little outwards: integrals over each half."""
    points, shift = sphere_points(), 0.005
    hidden = hidden_points(points, sphere_scene(), camera_at(5.0), np.full((256, 256), Label.OBJECT, np.uint8))
    dense = CENTRE + [shift, 0, 0] + RADIUS * unit_vectors(np.random.default_rng(1).normal(size=(100_000, 3)))
    apart = np.sqrt(cloud_distances(dense, points).truth)
    middle, product = (RADIUS**2 + shift**2) ** 1.5, 3 * RADIUS * shift
    apart_at_least = sampling_distance(4 * np.pi * RADIUS**2, len(dense))
    assert apart[hidden].mean() == pytest.approx(((RADIUS + shift) ** 3 - middle) / product - RADIUS, abs=apart_at_least / 2)
    assert apart[~hidden].mean() == pytest.approx(RADIUS - (middle - (RADIUS - shift) ** 3) / product, abs=apart_at_least / 2)


def test_mirrored_half_of_a_sphere_is_the_sphere():
    points, camera = sphere_points(), camera_at(50.0)
    visible = points[points[:, 0] > 0]
    whole = mirrored(visible, camera, CENTRE)
    assert len(whole) == 2 * len(visible)
    np.testing.assert_allclose(np.linalg.norm(whole - CENTRE, axis=1), RADIUS, rtol=1e-9)
    apart = np.sqrt(cloud_distances(whole, points).truth)
    assert apart.mean() < sampling_distance(4 * np.pi * RADIUS**2, len(whole))  # half of the points are in both
    assert whole[:, 0].mean() == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("height", [0.04, 0.09])
def test_extruded_disc_is_the_cylinder(height):
    """The box around a cylinder along the line of sight has the diagonal √(8 r² + h²)."""
    camera, (row, col) = camera_at(50.0), np.indices((256, 256)) + 0.5
    disc = np.hypot(row - 128, col - 128) <= 100
    made = extrude_silhouette(disc, camera, CENTRE, np.sqrt(8 * RADIUS**2 + height**2))
    assert np.ptp(made, axis=0) == pytest.approx([height, 2 * RADIUS, 2 * RADIUS], rel=0.01)
    body = trimesh.creation.cylinder(RADIUS, height, sections=128, transform=trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
    truth = trimesh.sample.sample_surface(body, 5000, seed=0)[0] + CENTRE
    apart = cloud_distances(made, truth)
    assert np.sqrt(apart.truth).max() < 0.0015
    assert np.sqrt(apart.truth).mean() < 0.0005


def test_extruded_disc_is_no_deeper_than_wide():
    row, col = np.indices((256, 256)) + 0.5
    made = extrude_silhouette(np.hypot(row - 128, col - 128) <= 100, camera_at(50.0), CENTRE, 1.0)
    assert np.ptp(made, axis=0) == pytest.approx([2 * RADIUS] * 3, rel=0.01)


def test_empty_silhouette_has_no_shape():
    assert extrude_silhouette(np.zeros((256, 256), bool), camera_at(5.0), CENTRE, 0.2).shape == (0, 3)


@pytest.mark.parametrize("stretch", [(1, 1, 1), (1, 1, 1.6)])
def test_smooth_surface_through_all_sides_is_the_body(stretch):
    """Points of a sphere or an ellipsoid; the surface misses it by less than half a per cent of its size."""
    directions = unit_vectors(np.random.default_rng(2).normal(size=(300, 3)))
    points, normals = CENTRE + RADIUS * directions * stretch, unit_vectors(directions / stretch)
    diagonal = 2 * RADIUS * float(np.linalg.norm(stretch))
    vertices, faces = smooth_surface(points, normals, CENTRE, diagonal)
    assert len(faces) > 1000
    radii = np.linalg.norm((vertices - CENTRE) / stretch, axis=1)
    np.testing.assert_allclose(radii, RADIUS, rtol=0.02)
    assert np.abs(radii - RADIUS).mean() < 0.005 * RADIUS


def test_smooth_surface_through_one_patch_is_closed_and_goes_through_it():
    directions = unit_vectors(np.random.default_rng(3).normal(size=(300, 3)) * [1, 0.2, 0.2] + [3.0, 0, 0])
    vertices, faces = smooth_surface(CENTRE + RADIUS * directions, directions, CENTRE, 2 * np.sqrt(3) * RADIUS)
    np.testing.assert_allclose(np.linalg.norm(vertices - CENTRE, axis=1), RADIUS, rtol=0.02)  # its mean is the sphere through them
    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight


def test_nothing_felt_has_no_surface():
    assert len(smooth_surface(np.zeros((0, 3)), np.zeros((0, 3)), CENTRE, 0.2)[1]) == 0


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory):
    """Evaluate networks on a ball of radius 0.12 m that has its size, beside a training ball; `none` is a larger sphere around it."""
    data = tmp_path_factory.mktemp("balls")
    spheres.make_data(data, 2, ("train", "test"))
    names = ("none", "occluded", "occluded-touch")
    for name in names:
        spheres.make_model(data, name, still=name == "none")
    settings = EvaluationSettings(points=500, grasps=(1, 5), configurations=names)
    request = Request(Evaluate(), settings, "balls", spheres.objects(2, ("train", "test")), "draft", 0, data)
    with pytest.MonkeyPatch.context() as patch:
        for module in ("stage", "protocols"):
            patch.setattr(f"stages.evaluate.{module}.has_paper_sizes", lambda _: False)
        patch.setattr("stages.evaluate.shape_baselines.MOST", 60)
        (plan,) = plans(request)
        plan.make(Console(file=io.StringIO()))
    return plan.directory.folder_path(plan.units[0].name)


def test_parts_of_a_ball_in_a_larger_one_are_as_far_as_the_whole(evaluation):
    figures = read_figures(evaluation)
    still = figures["none"]
    apart = still.by_object("mean_distance")
    assert apart > 0.05
    for part in LABELS:
        assert still.by_object(f"{part}_distance") == pytest.approx(apart, rel=0.1)
        assert np.isfinite(figures["occluded-touch"].by_object(f"{part}_distance", 5)).all()
    assert still.per_case("hidden_distance").shape == (1, 5)
    assert set(figures["training object, by truth"].means()) == {"mean_distance", "f_2mm", "f_5mm", "f_1percent", "chamfer"} | {
        f"{part}_distance" for part in LABELS
    }


def test_mirrored_and_smooth_shapes_of_a_ball_are_the_ball(evaluation):
    """As far as sampling allows: 500 points of a ball of 0.12 m are 9.5 mm apart from as many."""
    figures = read_figures(evaluation)
    least = sampling_distance(4 * np.pi * 0.12**2, 500)
    assert figures["shape, mirrored"].by_object("mean_distance") == pytest.approx(least, rel=0.15)
    for grasps in (1, 5):
        for name in ("shape, smooth through touches", "shape, smooth through touches and depth"):
            assert figures[name].by_object("mean_distance", grasps) == pytest.approx(least, rel=0.1)
    assert figures["shape, extruded"].by_object("mean_distance") > 0.05  # the silhouettes of these images are empty


def test_tables_show_what_touch_adds(evaluation):
    tables = {table.title.partition(":")[0]: table for table in evaluation_tables(evaluation)}
    rows = [[cell_text(cell) for cell in row.cells[:2]] for row in tables["What touch adds"].rows]
    networks = [["none", "0"], ["occluded", "0"], ["occluded-touch", "1"], ["occluded-touch", "5"]]
    smooth = [[f"baseline: Gaussian process through touches{end}", str(given)] for end in ("", " and exact depth") for given in (1, 5)]
    assert rows[:4] == networks
    assert rows[-4:] == smooth
    assert ["baseline: nearest training object", "–"] in rows
    compared = tables["Differences of distances, mm, object by object, with intervals, and in % of the second"].rows
    assert [row.cells[0] for row in compared] == ["occluded-touch − occluded", "occluded-touch: 5 grasps − 1"]
    figures = read_figures(evaluation)
    first, second = (1e3 * figures[name].by_object("hidden_near_distance") for name in ("occluded-touch", "occluded"))
    assert compared[0].cells[4] == f"{(first - second)[0]:+.2f}, {100 * (first / second - 1)[0]:+.0f} %"
    assert "Baselines" in tables
    assert not any("Gaussian" in str(row.cells[0]) for row in tables["Baselines"].rows)
