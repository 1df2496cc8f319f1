"""Every script in `examples/` runs, on a small dataset where it needs one."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.config.folder_sources import Catalogue
from pipeline.store.directory import DataDirectory
from stages.evaluate.evaluation_files import read_figures
from tests.command_line import vt
from tests.stages import ball_dataset as spheres

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 2)
    return folder


@pytest.fixture
def run(monkeypatch, capsys):
    """Run an example with arguments; what it printed."""

    def run_example(name: str, *arguments: object) -> str:
        monkeypatch.setattr("sys.argv", [name, *map(str, arguments)])
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        return capsys.readouterr().out

    return run_example


NAMES = "read_with_torch", "read_with_xarray", "slide", "touch_in_mujoco", "touch_in_pybullet", "touch_one_mesh", "train_one_network"


@pytest.mark.parametrize("name", NAMES)
def test_help_names_the_arguments(name, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", [name, "--help"])
    with pytest.raises(SystemExit, match="0"):
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert "default: " in capsys.readouterr().out


def test_read_with_torch_prints_shapes_and_touches(run, data):
    printed = run("read_with_torch", data, "test")
    assert "10 grasps of 2 objects in split test; failed: none" in printed
    assert "tactile_image (4, 100, 100, 3) torch.uint8" in printed
    assert "12 touches, nearest 5.0, 5.0" in printed


def test_read_with_xarray_selects_by_name(run, data):
    printed = run("read_with_xarray", data)
    assert "a, finger-0, grasp 1: min D = 5.00 mm, touch" in printed
    assert "a, finger-0, grasp 0: min D = 20.00 mm, no touch" in printed
    assert "bottle" in printed


def test_touch_one_mesh_writes_the_image_of_a_sphere_and_of_a_file(run, tmp_path):
    image, file = tmp_path / "tactile.png", tmp_path / "box.stl"
    assert "nearest 5.00 mm, gel 6.8 mm, success True" in run("touch_one_mesh", image)
    pixels = np.asarray(Image.open(image))
    assert pixels.shape == (100, 100, 3)
    assert pixels.std() > 1
    trimesh.creation.box((0.1, 0.1, 0.1)).export(file)
    assert "success True" in run("touch_one_mesh", image, file)


def test_touch_in_pybullet_prints_its_rate(run):
    printed = run("touch_in_pybullet", "gel_16mm", 20)
    assert "20 steps, 20 of them touch" in printed
    assert "tactile images per second" in printed


def test_touch_in_mujoco_lifts_an_egg_and_measures_what_its_motors_press_with(run):
    printed = run("touch_in_mujoco", 30)
    assert "frames of 240 x 320 pixels per second" in printed
    height, *forces = map(float, re.search(r"(\d+) mm above the floor, held by (\S+) and (\S+) N", printed).groups())
    assert height > 60  # 20 where it lay
    assert forces == pytest.approx([3.0, 3.0], rel=0.1)


def test_slide_prints_forces_and_writes_an_animation(run, tmp_path):
    printed = run("slide", tmp_path / "slide.webp", 8)
    assert "not settled" not in printed
    assert printed.endswith("slide.webp: 8 images\n")
    with Image.open(tmp_path / "slide.webp") as animation:
        assert (animation.size, animation.n_frames) == ((320, 240), 8)


def test_method_of_twenty_lines_is_scored(run, data, tmp_path):
    with pytest.raises(SystemExit, match=r"Usage: python examples/score_a_method\.py DATA FOLDER"):
        run("score_a_method")
    assert "2 spheres in" in run("score_a_method", data, tmp_path / "sphere")
    vt("score", tmp_path / "sphere", data)
    figures = read_figures(DataDirectory(data).verified_folder("scores/sphere"))["sphere"]
    assert (figures.per_object("mean_distance") < 0.02).all()  # the objects are balls: their touches decide on radius and place
    assert (figures.available("iou") > 0.7).all()


@pytest.mark.parametrize("name", ["grasp", "rgbd"])
def test_observations_have_no_faults_for_the_shipped_network(name, tmp_path):
    output = vt("check", EXAMPLES / "robot_grasp" / f"{name}.yaml", "--picture", tmp_path / "a.png")
    assert "no faults" in output
    assert "with model implicit-any, trained with objects of 0.5 m:" in output
    assert ("patches of the visible surface" in output) == (name == "rgbd")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.width > 1500  # and what the network is given


@pytest.mark.slow
def test_rgbd_observation_gives_a_closed_mesh_at_the_object(tmp_path):
    options = ["predict", str(tmp_path / "a.ply"), "--observation", str(EXAMPLES / "robot_grasp" / "rgbd.yaml"), "--surface", "closed"]
    vt(*options, "--resolution", "64")
    mesh = trimesh.load(tmp_path / "a.ply")
    assert mesh.is_watertight
    assert np.linalg.norm(mesh.bounds.mean(axis=0) - [0.62, -0.17, 0.25]) < 0.1


def test_train_one_network_lowers_its_loss(run, data):
    lines = run("train_one_network", data, "test", 2).splitlines()
    errors = [float(line.split()[2]) for line in lines]
    assert len(errors) == 2
    assert errors[1] < errors[0]


def test_every_example_is_short_and_tested():
    tests = Path(__file__).read_text()
    for path in EXAMPLES.glob("*.py"):
        assert len(path.read_text().splitlines()) < 50, path
        assert f'run("{path.stem}"' in tests


def test_catalogue_of_grasps_lists_objects_by_size(run, tmp_path):
    grasps, objects = tmp_path / "graspdata", tmp_path / "objects"
    objects.mkdir()
    for scene, scale in (("scale006_pose000", 0.06), ("scale012_pose000", 0.12)):
        (grasps / "mug" / scene).mkdir(parents=True)
        content = {"obj_scale": scale, "obj_pose": np.eye(7)[3], "grasp_qpos": np.array([0.0, 0, 0, 1, 0, 0, 0, 0.5])}
        np.save(grasps / "mug" / scene / "0.npy", np.array(content, object), allow_pickle=True)
    assert run("catalogue_of_grasps", grasps, objects) == "2 objects\n"
    source = {"kind": "catalogue", "licence": "x", "path": str(objects)}
    first, second = Catalogue.model_validate(source).list_objects(None)
    assert (first.object_id, first.source["metres_per_unit"]) == ("mug-scale006_pose000", 0.06)
    assert (second.object_id, second.source["metres_per_unit"]) == ("mug-scale012_pose000", 0.12)
