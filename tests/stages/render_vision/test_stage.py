import json
import shutil
from typing import Any

import numpy as np
import pytest
import yaml

from pipeline.dataset.completed_objects import dataset_scene
from pipeline.dataset.grasps import grasping_hand
from pipeline.dataset.mesh_rows import mesh_row
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Unit
from pipeline.errors import InvalidInput, StoreError
from pipeline.formats.description_file import description_path
from pipeline.formats.hand_file import load_hand
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.geometry.mesh_cleaning import POSITION
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.view_transfer import camera_direction
from pipeline.store.rows import Row
from schemas.base import COMMON
from stages.render_vision.stage import RenderVision, VisionSettings
from tests.kernels.vision.shapes import ball

STAGE = RenderVision()
HAND = "allegro_right"
GRASPS = 3


def task(name: str, radius: float) -> tuple[Unit, dict[str, Any]]:
    """Make a ball with the hand at three distances on the camera's side of it."""
    hand = load_hand("allegro_right")
    poses = np.tile(np.eye(4), (GRASPS, 1, 1))
    poses[:, :3, 3] = [[0.2, 0.1, 0.7], [0.3, 0.1, 0.7], [3.0, 3.0, 3.0]]  # the last out of sight, behind the camera
    angles = np.tile(np.clip(0.4, hand.lower, hand.upper), (GRASPS, 1))
    return Unit(name), {"surfaces": mesh_row(ball(radius)), "grasps": {"hand_pose": poses, "joint_angles": angles}}


def rows(settings: VisionSettings, *tasks: tuple[Unit, dict[str, Any]]) -> list[Row]:
    with STAGE.session(settings, {}) as process:
        return [process(*one) for one in tasks]


def test_rows_are_as_in_the_schema_and_show_object_and_hand() -> None:
    (row,) = rows(VisionSettings(hand=HAND), task("a", 0.15))
    assert {name: (array.shape, array.dtype.name) for name, array in row.items()} == {
        "unoccluded": ((1, 256, 256, 3), "uint8"),
        "occluded": ((GRASPS, 1, 256, 256, 3), "uint8"),
        "segmentation": ((1 + GRASPS, 1, 256, 256), "uint8"),
        "projection": ((1 + GRASPS, 1, 3, 4), "float64"),
    }
    declared = {name for name, array in STAGE.output.arrays.items() if array.per_object} - set(COMMON)
    assert set(row) == declared - {"camera_depth"}
    assert set(STAGE.constants(VisionSettings(hand=HAND))) == {"camera"}
    assert set(np.unique(row["segmentation"][0])) == {0, 1}
    for view in (1, 2):
        assert set(np.unique(row["segmentation"][view])) == {0, 1, 2}
    assert (row["segmentation"][3] == row["segmentation"][0]).all()
    assert (row["occluded"][2] == row["unoccluded"]).all()
    assert (row["segmentation"][2] == 2).sum() > (row["segmentation"][1] == 2).sum()  # nearer the camera, larger


def test_images_of_one_camera_do_not_depend_on_the_others(tmp_path) -> None:
    described = yaml.safe_load(description_path("scene", "supplement").read_text())
    (first,) = described["cameras"]
    closer = first | {"position": [0.486, 0.2305, 0.787], "name": "closer"}
    path = tmp_path / "three.yaml"
    path.write_text(json.dumps(described | {"cameras": [first, first | {"name": "again"}, closer], "depth": True}))
    plain, several = VisionSettings(hand=HAND, resolution=64), VisionSettings(hand=HAND, resolution=64, scene=str(path))
    (before,), (row,) = rows(plain, task("a", 0.1)), rows(several, task("a", 0.1))
    for name, axis in (("unoccluded", 0), ("occluded", 1), ("segmentation", 1)):
        for camera in (0, 1):
            assert (np.take(row[name], [camera], axis) == before[name]).all()
    constants = STAGE.constants(several)
    assert constants["camera"].tolist() == ["front", "again", "closer"]
    assert (row["projection"][:, :2] == before["projection"]).all()
    for name, array in {**row, **constants}.items():
        declared = STAGE.output.arrays[name]
        assert array.ndim == len([dim for dim in declared.dims if dim != "object"]), name
    assert (np.isfinite(row["camera_depth"]) == (row["segmentation"] > 0)).all()
    assert row["camera_depth"][0, 2].min() < row["camera_depth"][0, 0].min() - 0.5  # half as far
    covered = [(image != image[0, 0]).any(axis=-1).sum() for image in row["unoccluded"]]
    assert covered[2] > 2.5 * covered[0]  # at half the distance four times as large, where it is not cut off


def test_drawn_cameras_look_at_the_object_from_their_ranges_and_show_it_as_large(tmp_path) -> None:
    described = yaml.safe_load(description_path("scene", "supplement").read_text())
    drawn = {"distance": [0.3, 0.8], "elevation": [10, 20], "azimuth": [170, 200]}
    path = tmp_path / "drawn.yaml"
    path.write_text(json.dumps(described | {"cameras": [described["cameras"][0] | {"drawn": drawn}]}))
    settings = VisionSettings(hand=HAND, resolution=64, scene=str(path))
    (row,), (again,), (other,) = (rows(settings, task(name, 0.05)) for name in "aab")
    assert (row["projection"] == again["projection"]).all()
    assert not (row["projection"] == other["projection"]).any(axis=(2, 3)).all()
    matrices = np.concatenate([row["projection"], other["projection"]])[:, 0]
    assert len(np.unique(matrices, axis=0)) == 2 * (1 + GRASPS)
    for matrix in matrices:
        direction = camera_direction(matrix, POSITION)
        assert 0.3 <= direction.distance <= 0.8
        assert 10 <= np.degrees(direction.elevation) <= 20
        assert 170 <= np.degrees(direction.azimuth) % 360 <= 200
        assert project_points(matrix, POSITION) == pytest.approx([32, 32])
    areas = [(view == 1).sum() for view in (row["segmentation"][0, 0], other["segmentation"][0, 0])]
    assert areas[0] == pytest.approx(areas[1], rel=0.05)
    for fault, words in ({"distance": [0.8, 0.3]}, "the least comes first"), ({"elevation": [0, 90]}, "elevation"):
        path.write_text(json.dumps(described | {"cameras": [described["cameras"][0] | {"drawn": drawn | fault}]}))
        with pytest.raises(InvalidInput, match=words):
            load_scene(path)


def test_cameras_need_not_be_square_but_have_one_size(tmp_path) -> None:
    described = yaml.safe_load(description_path("scene", "supplement").read_text())
    del described["cameras"][0]["resolution"]
    wide = described["cameras"][0] | {"name": "wide", "size": [96, 48], "centre": [48, 24]}
    path = tmp_path / "wide.yaml"
    path.write_text(json.dumps(described | {"cameras": [wide]}))
    (row,) = rows(VisionSettings(resolution=64, scene=str(path), hand=HAND), task("a", 0.1))
    assert row["occluded"].shape == (GRASPS, 1, 48, 96, 3)
    scene, attributes = load_scene(path), STAGE.attributes(VisionSettings(scene=str(path), hand=HAND))
    path.unlink()
    assert dataset_scene(json.loads(json.dumps(attributes))) == scene
    with pytest.raises(StoreError, match="delete `vision`"):
        dataset_scene({})
    for cameras, words in (
        ([wide, wide | {"name": "tall", "size": [48, 96]}], "images of several sizes"),
        ([wide | {"resolution": 512}], r"resolution 512 and size \[96, 48\] are two sizes of one image"),
        ([wide, wide], "two cameras are called wide; rename one"),
    ):
        path.write_text(json.dumps(described | {"cameras": cameras}))
        with pytest.raises(InvalidInput, match=words):
            load_scene(path)


def test_hand_other_than_that_of_the_grasps_is_refused() -> None:
    with pytest.raises(InvalidInput, match=r"of hand other, render-vision.hand is allegro_right; leave it out, or --set hand=other"):
        STAGE.check_inputs(VisionSettings(hand=HAND), {"grasps": {"settings": {"hand": "other"}, "hand": {"digest": "0" * 64}}})


def test_recorded_hand_that_is_in_another_folder_is_named_with_the_way_out() -> None:
    attributes = {"grasps": {"settings": {"hand": "two/h.yaml"}}}
    words = "the dataset records the hand 'two/h.yaml', a path from the folder where it was made: run this there, or "
    with pytest.raises(InvalidInput, match=words + "name the file with --set render-vision.hand=PATH"):
        STAGE.check_inputs(STAGE.resolve_settings(VisionSettings(), attributes), attributes)
    assert STAGE.resolve_settings(VisionSettings(hand=HAND), attributes).hand == HAND
    with pytest.raises(InvalidInput, match=words + "put it there"):
        grasping_hand(attributes)


def test_hand_whose_mesh_changed_since_the_grasps_is_refused(tmp_path) -> None:
    hand = load_hand("allegro_right")
    shutil.copytree(hand.path.parent, tmp_path / "hands")
    copied = str(tmp_path / "hands" / hand.path.name)
    grasps = {"settings": {"hand": copied}, "hand": {"digest": assets_digest(load_hand(copied).files)}}
    STAGE.check_inputs(VisionSettings(hand=copied), {"grasps": grasps})
    STAGE.check_inputs(VisionSettings(hand=HAND), {"grasps": grasps})  # the same hand, wherever its files lie
    mesh = next(file for file in load_hand(copied).files if file.suffix.lower() in {".stl", ".obj"})
    mesh.write_bytes(mesh.read_bytes() + b"\n")
    with pytest.raises(InvalidInput, match=r"the files of hand .* have changed since the grasps were made; run simulate-grasps again"):
        STAGE.check_inputs(VisionSettings(hand=copied), {"grasps": grasps})


def test_image_does_not_depend_on_earlier_objects() -> None:
    settings = VisionSettings(hand=HAND, resolution=64)
    (alone,) = rows(settings, task("b", 0.1))
    _, after = rows(settings, task("a", 0.2), task("b", 0.1))
    assert all((alone[name] == after[name]).all() for name in alone)


def test_without_occluded_only_the_object_is_rendered() -> None:
    (row,) = rows(VisionSettings(hand=HAND, occluded=False, resolution=64), task("a", 0.15))
    assert set(row) == {"unoccluded", "segmentation", "projection"}
    assert row["segmentation"].shape == (1, 1, 64, 64)


def test_assets_are_files_and_attributes_describe_the_scene() -> None:
    assets = STAGE.assets(VisionSettings(hand=HAND))
    assert all(path.is_file() for path in assets)
    assert {"supplement.yaml", "allegro_right.yaml", "mesh.frag"} <= {path.name for path in assets}
    assert "position" in STAGE.attributes(VisionSettings(hand=HAND))["scene"]["lamp"]
