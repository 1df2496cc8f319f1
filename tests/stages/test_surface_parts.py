"""Parts of surfaces near touches and hidden from cameras, against closed forms, and the tables of their errors."""

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
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.scene import Label
from pipeline.tables.evaluation_tables import evaluation_tables
from stages.evaluate.evaluation_files import read_figures
from stages.evaluate.stage import Evaluate, EvaluationSettings
from stages.evaluate.surface_parts import LABELS, hidden_points
from tests.stages import ball_dataset as spheres
from tests.stages.sphere_views import CENTRE, RADIUS, camera_at, sphere_points


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


def test_tables_show_what_touch_adds(evaluation):
    tables = {table.title.partition(":")[0]: table for table in evaluation_tables(evaluation)}
    rows = [[cell_text(cell) for cell in row.cells[:2]] for row in tables["What touch adds"].rows]
    networks = [["none", "0"], ["occluded", "0"], ["occluded-touch", "1"], ["occluded-touch", "5"]]
    assert rows[:4] == networks
    assert ["baseline: nearest training object", "–"] in rows
    compared = tables["Differences of distances, mm, object by object, with intervals, and in % of the second"].rows
    assert [row.cells[0] for row in compared] == ["occluded-touch − occluded", "occluded-touch: 5 grasps − 1"]
    figures = read_figures(evaluation)
    first, second = (1e3 * figures[name].by_object("hidden_near_distance") for name in ("occluded-touch", "occluded"))
    assert compared[0].cells[4] == f"{(first - second)[0]:+.2f}, {100 * (first / second - 1)[0]:+.0f} %"
