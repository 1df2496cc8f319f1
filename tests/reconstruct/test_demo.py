"""The demo simulates a grasp and writes all of its files; the network has random weights."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.dataset.object_rows import sensors_of
from pipeline.reconstruct import demo
from pipeline.store.directory import DataDirectory
from schemas.grasps import GRASPS
from schemas.touch import TOUCH
from tests.command_line import vt
from tests.stages import ball_dataset as spheres
from tools.overview_picture import draw_overview


@pytest.mark.slow
def test_demo_writes_closed_coloured_meshes_a_turntable_and_what_the_overview_shows(tmp_path, monkeypatch):
    spheres.make_implicit_model(tmp_path, "implicit-gels", spacing=0.05)
    monkeypatch.setattr(demo, "shipped_models", lambda: tmp_path / "models")
    shown = []
    monkeypatch.setattr(demo, "demo", lambda *of, run=demo.demo: shown.append(run(*of)) or shown[0])
    folder = tmp_path / "demo"
    printed = vt("demo", folder)
    for file in (f"{demo.OBJECT}.glb", f"{demo.OBJECT}-from-image.glb"):
        assert file in printed
        mesh = trimesh.load(folder / file, force="mesh")
        assert mesh.is_watertight
        colors = np.asarray(mesh.visual.vertex_colors)[:, :3]
        assert len(np.unique(colors, axis=0)) > 1  # colours of the image, and grey
    with Image.open(folder / "turntable.webp") as turntable:
        assert turntable.size == (2 * demo.PIXELS, demo.PIXELS)
        assert turntable.n_frames == demo.FRAMES
    touch = DataDirectory(folder / "data").collection(TOUCH).first
    assert {sensor.name for sensor in sensors_of(touch)} == {"gelsight_mini"}
    rows, columns = touch.read("tactile_image").shape[3:5]
    for file, size in (("seen.png", (192, 192)), ("felt.png", (4 * columns, rows))):
        with Image.open(folder / file) as image:
            assert image.size == size
    assert DataDirectory(folder / "data").collection(GRASPS).first.read("joint_angles").shape[:2] == (1, 1)  # one object, one grasp
    draw_overview(shown[0], tmp_path / "overview.png")
    with Image.open(tmp_path / "overview.png") as overview:
        assert len(np.unique(np.asarray(overview).reshape(-1, np.asarray(overview).shape[2]), axis=0)) > 1000


def test_demo_shows_an_object_of_the_test_split():
    from pipeline.config.manifest import load_manifest

    (shown,) = [item for item in load_manifest(demo.MANIFEST).objects(None) if item.object_id == demo.OBJECT]
    assert shown.split == "test"


def test_demo_refuses_a_folder_of_another_dataset(tmp_path):
    spheres.make_data(tmp_path / "data", 1, ("train",))
    assert "holds another dataset" in vt("demo", tmp_path, fails=True)


def test_demo_says_before_it_simulates_that_its_network_is_missing(tmp_path, monkeypatch):
    spheres.make_implicit_model(tmp_path, "implicit-any")
    monkeypatch.setattr(demo, "shipped_models", lambda: tmp_path / "models")
    printed = " ".join(vt("demo", tmp_path / "demo", fails=True).split())
    assert f"has no model {demo.NETWORK}: its models are implicit-any" in printed
    assert not (tmp_path / "demo").exists()


def test_a_turn_shows_all_of_what_turns(tmp_path):
    """A tall thin thing, which a camera fitted to a cube of its size cuts off, is as large in each picture and whole."""
    from pipeline.kernels.geometry.mesh import Look, Mesh

    box = trimesh.creation.box((0.02, 0.06, 0.3))
    faces = np.asarray(box.faces, np.int32)
    mesh = Mesh(np.asarray(box.vertices), faces, Look.plain(len(box.vertices), len(faces), (0, 0, 0)))
    demo.draw_turntable(mesh, mesh, tmp_path / "turn.webp")
    with Image.open(tmp_path / "turn.webp") as turn:
        for frame in range(turn.n_frames):
            turn.seek(frame)
            view = np.asarray(turn.convert("L"))[:, : demo.PIXELS]
            rim = np.concatenate([view[0], view[-1], view[:, 0], view[:, -1]])
            assert rim.min() > 200  # background
            assert (view < 128).any()
