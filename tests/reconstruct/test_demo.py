"""The demo simulates a grasp and writes all of its files; the network has random weights."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.models.touch_model import save_touch_model
from pipeline.reconstruct.demo import FRAMES, PIXELS
from pipeline.store.directory import DataDirectory
from schemas.grasps import GRASPS
from tests.command_line import vt
from tests.engine.tiny_stages import publish
from tests.stages import ball_dataset as spheres


@pytest.mark.slow
def test_demo_writes_a_closed_coloured_mesh_and_a_turntable(tmp_path, monkeypatch):
    spheres.make_implicit_model(tmp_path, "implicit-any", spacing=0.05)
    (unet := tmp_path / "made").mkdir()
    save_touch_model(unet, UNet(4), sensor=spheres.SENSOR, untouched=untouched_image(spheres.SENSOR), mask_threshold=1e-3)
    publish(tmp_path, "models/unet", unet, "train-unet")
    monkeypatch.setattr("pipeline.reconstruct.demo.shipped_models", lambda: tmp_path / "models")
    folder = tmp_path / "demo"
    vt("demo", folder)
    mesh = trimesh.load(folder / "bottle-0001.glb", force="mesh")
    assert mesh.is_watertight
    colors = np.asarray(mesh.visual.vertex_colors)[:, :3]
    assert len(np.unique(colors, axis=0)) > 1  # colours of the image, and grey
    with Image.open(folder / "turntable.webp") as turntable:
        assert turntable.size == (2 * PIXELS, PIXELS)
        assert turntable.n_frames == FRAMES
    with Image.open(folder / "seen.png") as seen:
        assert seen.size == (256, 256)
    assert DataDirectory(folder / "data").collection(GRASPS).first.read("joint_angles").shape[:2] == (1, 1)  # one object, one grasp


def test_demo_refuses_a_folder_of_another_dataset(tmp_path):
    spheres.make_data(tmp_path / "data", 1, ("train",))
    assert "holds another dataset" in vt("demo", tmp_path, fails=True)
