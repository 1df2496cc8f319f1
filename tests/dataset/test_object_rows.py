"""`ObjectRows` reads any arrays of objects in any order with bounded memory."""

import shutil
from collections import Counter
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from torch.utils.data import DataLoader

from pipeline.config.settings import Settings
from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.dataset.labelled import open_artifact
from pipeline.dataset.mesh_rows import mesh_row, read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.plan import Request
from pipeline.errors import StoreError
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.store.directory import DataDirectory
from pipeline.store.shard import Shard
from schemas.catalogue import artifact_of
from schemas.presses import PRESSES
from schemas.touch import TOUCH
from schemas.vision import VISION
from tests.engine.tiny_stages import pack
from tests.stages import ball_dataset

ARRAYS = ("points", "occluded", "depth", "tactile_image", "sensor_pose", "touch_success", "untouched")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("balls")
    ball_dataset.make_data(folder, 3)
    return folder


@pytest.mark.parametrize("megabytes", [0, 1, 1000])
def test_arrays_read_in_any_order_equal_the_stored_ones_for_any_cache_size(data, megabytes, rng):
    rows, directory = ObjectRows(data, ARRAYS, "test", cache_megabytes=megabytes), DataDirectory(data)
    queries = [(name, object_id, grasp) for name in ARRAYS for object_id in rows.object_ids for grasp in (None, 0, 3)]
    for number in rng.permutation(2 * len(queries)):
        name, object_id, grasp = queries[number // 2]
        stored = directory.collection(artifact_of(name)).view(object_id)[name]
        by_grasp = grasp is not None and "grasp" in artifact_of(name).arrays[name].dims
        np.testing.assert_array_equal(rows.read(name, object_id, grasp), stored[grasp] if by_grasp else stored)


def test_cache_is_bounded(data):
    limit = 200_000  # bytes
    rows = ObjectRows(data, ARRAYS, "test", cache_megabytes=limit / 1e6)
    for object_id in rows.object_ids:
        for name in ARRAYS:
            last = rows.read(name, object_id, 1)
            assert rows._cache._bytes <= max(limit, last.nbytes, max(array.nbytes for array in rows._cache._arrays.values()))


def test_arrays_without_a_grasp_axis_are_read_once_per_object(data, monkeypatch):
    reads: Counter[str] = Counter()
    genuine = Shard.read
    monkeypatch.setattr(Shard, "read", lambda shard, name, index=...: (reads.update([name]), genuine(shard, name, index))[1])
    dataset = GraspDataset(data, ARRAYS, "test")
    assert len([dataset[index] for index in range(len(dataset))]) == 15
    assert reads["points"] == reads["depth"] == reads["tactile_image"] == 3
    assert reads["untouched"] == 1


def test_one_grasp_is_read_without_the_others(data, monkeypatch):
    indices: list[object] = []
    genuine = Shard.read
    monkeypatch.setattr(Shard, "read", lambda shard, name, index=...: (indices.append(index), genuine(shard, name, index))[1])
    rows = ObjectRows(data, ["depth"], "test")
    assert rows.read("depth", "b", 3).shape == rows.read("depth", "b", 0)[None].shape[1:]
    (position, grasp, *_), whole = indices
    assert (grasp, whole) == (3, position), "by object and grasp, then the whole object"


def test_one_camera_is_read_without_the_others(tmp_path):
    cameras, images = np.array(["front", "left", "above"]), np.random.default_rng(0).integers(0, 256, (3, 90, 90, 3), np.uint8)
    row = {"unoccluded": images, "occluded": np.stack([images, 255 - images]), "segmentation": np.tile(images[..., 0], (3, 1, 1, 1))}
    row |= {"projection": np.zeros((3, 3, 3, 4))}
    items = ball_dataset.objects(2)
    stage: Any = ball_dataset.Given(VISION, lambda unit: row, (), {"camera": cameras}, {})
    pack(Request(stage=stage, settings=Settings(), objects=items, manifest="m", preset="draft", seed=0, data=tmp_path), lambda unit: row)
    rows = ObjectRows(tmp_path, ["unoccluded", "occluded", "segmentation"], None)
    name, shard = rows.object_ids[0], DataDirectory(tmp_path).collection(VISION).first
    for array, axis in (("unoccluded", 1), ("occluded", 2), ("segmentation", 2)):
        assert shard.stored(array).chunks[axis] == 1, "each camera is a chunk"
        assert (rows.read(array, name) == row[array]).all()
        assert (rows.read(array, name, camera=1) == np.take(row[array], 1, axis - 1)).all()
    assert (rows.read("occluded", name, 1, camera=2) == row["occluded"][1, 2]).all()
    with pytest.raises(StoreError, match=f"^{name} has no camera 3; there are 3, numbered from 0$"):
        rows.read("unoccluded", name, camera=3)
    with pytest.raises(StoreError, match=f"^{name} has no grasp 2; there are 2, numbered from 0$"):
        rows.read("occluded", name, 2)
    with pytest.raises(StoreError, match="array depth was not opened, only unoccluded, occluded, segmentation; name it when"):
        rows.read("depth", name)


def test_meshes_come_with_each_grasp_and_batches_list_them(data):
    arrays = ["depth", "meshes/vertices", "meshes/faces"]
    grasps = GraspDataset(data, arrays, "test")
    (batch,) = DataLoader(grasps, batch_size=len(grasps), collate_fn=grasps.collate)
    assert batch["depth"].shape[:2] == (15, 4)
    radii = [float((vertices - torch.tensor(ball_dataset.CENTRE)).norm(dim=1).mean()) for vertices in batch["meshes/vertices"]]
    np.testing.assert_allclose(radii, np.repeat([0.1, 0.12, 0.14], 5))
    assert all(faces.max() == len(vertices) - 1 for vertices, faces in zip(batch["meshes/vertices"], batch["meshes/faces"], strict=True))


def test_mesh_array_that_an_object_lacks_is_named(data):
    with pytest.raises(StoreError, match="a has no array meshes/texture_0; there are meshes/base_color"):
        GraspDataset(data, ["meshes/texture_0"], "test")[0]


def test_arrays_of_other_numbers_than_grasps_come_whole(data, tmp_path):
    shutil.copytree(data, copy := tmp_path / "copy")
    images, shape = np.random.default_rng(0).integers(0, 256, (7, 20, 20, 3), np.uint8), (7, 20, 20)
    row = {"press_shape": np.zeros(7, np.uint8), "press_depth": np.zeros(shape, np.float32), "press_image": images}
    row |= {"press_indentation": np.zeros(shape, np.float32), "press_contact": np.zeros(shape, bool)}
    stage: Any = ball_dataset.Given(PRESSES, lambda unit: row, (), {"press_untouched": images[0]}, {})
    items = ball_dataset.objects(3, ("test",))
    pack(Request(stage=stage, settings=Settings(), objects=items, manifest="m", preset="draft", seed=0, data=copy), lambda unit: row)
    dataset = GraspDataset(copy, ["press_image", "press_shape", "difference"], "test")
    assert dataset.items[1][1] == 1
    assert (dataset[1]["press_image"].numpy() == images).all()
    assert dataset[1]["press_shape"].shape == (7,)
    assert dataset[1]["difference"].ndim == 4
    assert (dataset.rows.read("press_image", dataset.items[1][0], 1) == images[1]).all(), "one press, for whoever asks"


def test_cached_arrays_are_read_only_and_tensors_are_writable(data):
    rows = ObjectRows(data, ["points"], "test")
    with pytest.raises(ValueError, match="read-only"):
        rows.read("points", "a")[0] = 0
    GraspDataset(data, ["points"], "test")[0]["points"].zero_()


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (lambda data: ObjectRows(data, ["taste"], "test"), "no artifact has an array taste"),
        (lambda data: ObjectRows(data, ["tactile_imge"], "test"), "no artifact has an array tactile_imge, did you mean tactile_image?"),
        (lambda data: ObjectRows(data, ["local_count", "smell"], "test"), "no artifact has an array smell"),
        (lambda data: ObjectRows(data, ["points"], "train"), "no usable object in split train, but in test; the manifest"),
        (lambda data: ObjectRows(data / "nowhere", ["points"]), "nowhere is not a data directory; make one with"),
        (lambda data: open_artifact(data, "taste"), "unknown artifact taste; choose from surfaces"),
        (lambda data: open_artifact(data / "nowhere", "touch"), "touch has not been made"),
    ],
)
def test_unknown_names_and_empty_splits_are_named(data, read, message):
    with pytest.raises(StoreError) as error:
        read(data)
    assert message in str(error.value)


def test_xarray_has_coordinates_for_any_number_of_shards(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shards")
    ball_dataset.make_data(folder, 3, shards=3)
    rows = ObjectRows(data, ["depth", "joint_angles"], "test")
    for directory in (data, folder):
        touch, grasps = open_artifact(directory, "touch"), open_artifact(directory, "grasps")
        finger = str(touch.sensor[1].item())
        assert touch.depth.chunks is None or set(touch.depth.chunks[0]) == {1}, "an object is read without the others of its shard"
        np.testing.assert_array_equal(touch.depth.sel(object="b", sensor=finger, grasp=4), rows.read("depth", "b", 4)[1])
        np.testing.assert_array_equal(grasps.joint_angles.sel(object="c", joint=grasps.joint[2]), rows.read("joint_angles", "c")[:, 2])
        assert touch.depth.attrs["units"] == "m"
        assert str(touch.category.sel(object="b").item()) == "knife"


def test_shard_of_failed_objects_takes_arrays_and_sizes_from_the_others(tmp_path):
    ball_dataset.make_data(tmp_path, 3, ungrasped="b", shards=4)  # b is alone in the first shard of three
    rows = ObjectRows(tmp_path, ["depth", "occluded"], None)
    assert rows.object_ids == ["a", "c"]
    assert (rows.size("depth", "grasp"), rows.size("occluded", "rgb")) == (5, 3)
    for name, array in (("touch", "depth"), ("vision", "occluded")):
        opened = open_artifact(tmp_path, name)
        assert opened.ok.values.tolist() == [True, False, True]
        assert opened[array].dtype == artifact_of(array).arrays[array].dtype
        assert not opened[array].sel(object="b").values.any()
        np.testing.assert_array_equal(opened[array].sel(object="c"), rows.read(array, "c"))


@pytest.mark.parametrize("label", ["object", "category", "ok"])
def test_an_artifact_with_a_damaged_label_is_not_opened(data, tmp_path, label):
    shutil.copytree(data, tmp_path, dirs_exist_ok=True)
    (chunk,) = (path for path in (DataDirectory(tmp_path).collection(TOUCH).first.path / label / "c").rglob("*") if path.is_file())
    content = bytearray(chunk.read_bytes())
    content[-1] ^= 1
    chunk.write_bytes(content)
    with pytest.raises(StoreError, match=r"cannot be (read|opened) .*--check"):
        open_artifact(tmp_path, "touch")


@pytest.mark.parametrize("sensors", [[], None, [{"name": "x", "width": "wide"}]])
def test_unusable_sensor_attributes_are_refused(data, sensors):
    rows = ObjectRows(data, ["tactile_image"], "test")
    rows.collections["touch"].first.attributes = {"sensors": sensors}
    with pytest.raises(StoreError, match=r"its sensor cannot be used .*--check"):
        rows.sensor()


def test_hand_with_different_sensors_has_no_single_sensor(data):
    rows = ObjectRows(data, ["tactile_image"], "test")
    sensor_entry = rows.attributes("touch")["sensors"][0]
    thin = {**sensor_entry, "name": "thin", "w": sensor_entry["w"] / 2}
    rows.collections["touch"].first.attributes = {"sensors": [sensor_entry, thin]}
    assert [sensor.w for sensor in rows.sensors()] == [sensor_entry["w"], sensor_entry["w"] / 2]
    with pytest.raises(StoreError, match=r"the fingers wear different sensors \(gel_16mm, thin\).* needs a hand that wears one"):
        rows.sensor()


def test_difference_image_is_tactile_image_minus_untouched_image(data):
    rows = ObjectRows(data, ["difference"], None)
    tactile_image, untouched = (rows.read(name, "b").astype(int) for name in ("tactile_image", "untouched"))
    assert (rows.read("difference", "b") == tactile_image - untouched).all()
    assert (rows.read("difference", "b", 1) == rows.read("difference", "b")[1]).all()
    assert rows.read("difference", "b").dtype == np.int16


def test_mesh_row_round_trip_keeps_all_bits() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    mesh = Mesh.bare(ball.vertices * 1e-3 + 1e3, ball.faces)
    restored = read_mesh(mesh_row(mesh))
    assert restored.triangles.tobytes() == mesh.triangles.tobytes()
    assert restored.look.textures == ()
