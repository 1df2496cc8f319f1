"""`vt-pipeline check` of observations: what they show, and what a network is given of them."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.formats.scene_file import load_scene
from pipeline.kernels.vision.camera import projection_matrix
from pipeline.reconstruct.observation_checks import check
from pipeline.reconstruct.observation_picture import draw_observation
from pipeline.reconstruct.observation_placement import place_observation
from tests.command_line import vt
from tests.reconstruct.robot import target, write_files, write_observation

CAMERA = projection_matrix(load_scene("supplement").camera).tolist()


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_observation_is_described_and_drawn(tmp_path: Path, unit: str) -> None:
    entries = write_files(tmp_path)
    entries["touches"][1]["pose"] = (np.array(entries["touches"][1]["pose"]) @ np.diag([1.0, -1, -1, 1])).tolist()
    if unit == "mm":
        entries["unit"] = unit
        entries["object"] = {"centre": [1e3 * value for value in entries["object"]["centre"]]}
        for holder in (entries["camera"], *entries["touches"]):
            holder["pose"] = (np.array(holder["pose"]) * np.vstack([[[1, 1, 1, 1e3]] * 3, [[1, 1, 1, 1]]])).tolist()
    path = write_observation(tmp_path, entries)
    lines = draw_observation(path, tmp_path / "a.png", target("touch"))
    place = {
        "m": "[0.4, -0.1, 0.2] m (as stated), diagonal 0.208 m",
        "mm": "[400, -100, 200] mm (as stated), diagonal 203 mm, by its mask",
    }[unit]
    assert lines[:2] == [f"{path}: observation, no faults", f"object at {place}"]
    assert lines[2] == "camera: 160 x 120 pixels; 21.5% of the photograph is the object"
    assert lines[3] == "touches.0: touches if its image, depth or points show so, 59 mm from the object's centre"
    assert any("touches.1 face away" in line for line in lines)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.width > 900


def test_observation_is_checked_against_a_model_and_drawn_as_its_input(tmp_path: Path) -> None:
    path = write_observation(tmp_path, write_files(tmp_path))
    lines = draw_observation(path, tmp_path / "a.png", target().model_copy(update={"camera": CAMERA, "resolution": (256, 256)}))
    assert "with model occluded-touch, trained with objects of 0.5 m:" in lines
    assert any("the views differ by 19.2°" in line for line in lines)
    assert any("give camera.hand_mask too" in line for line in lines)
    printed = vt("check", "supplement", "--picture", tmp_path / "b.png", "--models", "pretrained", fails=True)
    assert "is a scene file; only an observation is checked against models" in printed


def test_masks_that_are_inverted_or_hide_the_object_are_named(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    mask = np.asarray(Image.open(tmp_path / "mask.png"))
    Image.fromarray(255 - mask).save(tmp_path / "inverted.png")
    for changes, words in (
        ({"mask": "inverted.png"}, "camera.mask holds most of the photograph's border: is it inverted?"),
        ({"hand_mask": "inverted.png"}, "camera.hand_mask holds most of the photograph's border: is it inverted?"),
        ({"hand_mask": "mask.png"}, "camera.hand_mask covers all of the object: is it inverted?"),
    ):
        path = write_observation(tmp_path, entries | {"camera": entries["camera"] | changes})
        assert f"warning: {words}" in place_observation(check(path, target("unoccluded"))).remarks


def test_a_photograph_of_one_pixel_is_drawn(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    Image.fromarray(np.full((1, 1, 3), 90, np.uint8)).save(tmp_path / "seen.png")
    del entries["camera"]["mask"]
    entries["camera"]["intrinsics"] = {"fx": 10, "fy": 10, "cx": 0.5, "cy": 0.5}
    assert draw_observation(write_observation(tmp_path, entries), tmp_path / "a.png", target("touch"))
