"""Exports: contents of WebDataset shards, and errors. Other libraries read their formats in `read_back.py`."""

import errno
import importlib.util
import io
import json
import os
import tarfile
import warnings
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.config.settings import Settings
from pipeline.contrib.exports.grasp_frames import Column, GraspFrames
from pipeline.contrib.exports.lerobot_files import QUANTILES, _Statistics
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.plan import Request
from pipeline.engine.stage import Unit
from pipeline.errors import StoreError
from pipeline.store.atomic import atomic_writes
from pipeline.store.rows import Row
from tests.command_line import vt
from tests.engine.tiny_stages import pack
from tests.stages import ball_dataset

FINGERS = [f"finger-{number}" for number in range(4)]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    ball_dataset.make_data(folder, 2)
    return folder


def add_forces(unit: Unit, artifact: str, row: Row) -> Row:
    """Add what an elastic gel and a hold test give to the rows of a ball."""
    if artifact == "grasps":
        return row | {"held": np.arange(len(row["hand_pose"])) % 2 == 0}
    if artifact != "touch":
        return row
    pressure = np.maximum(ball_dataset.SENSOR.w - row["depth"], 0).astype(np.float32) * np.float32(1e7)  # Pa
    pixel = ball_dataset.SENSOR.width * ball_dataset.SENSOR.height / pressure[0, 0].size
    return row | {"pressure": pressure, "force": (pressure.sum(axis=(-2, -1)) * pixel).astype(np.float32)}


@pytest.fixture(scope="module")
def elastic(tmp_path_factory) -> Path:
    """Return a dataset of balls with pressure, force and held."""
    folder = tmp_path_factory.mktemp("elastic")
    ball_dataset.make_data(folder, 2)
    for stage in ball_dataset.stages()[1:4]:
        request = Request(stage, Settings(), "balls", ball_dataset.objects(2), "draft", 1, folder)
        pack(request, lambda unit, stage=stage: add_forces(unit, stage.output.name, stage.row(unit)))
    return folder


def files_in(shard: Path) -> dict[str, bytes]:
    with tarfile.open(shard) as tar:
        return {member.name: tar.extractfile(member).read() for member in tar}


def test_webdataset_shards_hold_every_grasp_unchanged(data, tmp_path):
    output = vt("export", data, tmp_path / "out", "--to", "webdataset")
    shards = sorted((tmp_path / "out").glob("*.tar"))
    frames = GraspFrames(data)
    assert [shard.name for shard in shards] == [f"{split}-000000.tar" for split in sorted(frames.object_ids)]
    rows = ObjectRows(data, ["depth", "tactile_image"], split=None)
    samples = 0
    for shard in shards:
        files = files_in(shard)
        for key in {name.partition(".")[0] for name in files}:
            about = json.loads(files[f"{key}.json"])
            depth = np.load(io.BytesIO(files[f"{key}.depth_{FINGERS[2]}.npy"]))
            image = np.asarray(Image.open(io.BytesIO(files[f"{key}.tactile_image_{FINGERS[2]}.png"])))
            np.testing.assert_array_equal(depth, rows.read("depth", about["object_id"], about["grasp"])[2])
            np.testing.assert_array_equal(image, rows.read("tactile_image", about["object_id"], about["grasp"])[2])
            samples += 1
    assert f"{samples} grasps" in output
    vt("export", data, tmp_path / "again", "--to", "webdataset")
    assert [(tmp_path / "again" / shard.name).read_bytes() for shard in shards] == [shard.read_bytes() for shard in shards]


def test_frames_have_forces_pressures_and_what_held_with_their_units(elastic):
    frames, rows = GraspFrames(elastic), ObjectRows(elastic, ["force", "pressure", "held"], split=None)
    assert (frames.columns[f"force.{FINGERS[0]}"].unit, frames.columns[f"pressure.{FINGERS[3]}"].unit) == ("N", "Pa")
    for _, of_object in frames.episodes():
        for grasp, frame in enumerate(of_object):
            force, pressure, held = (rows.read(name, frame["object_id"], grasp) for name in ("force", "pressure", "held"))
            assert [frame[f"force.{finger}"] for finger in FINGERS] == force.tolist()
            assert frame["held"] is (grasp % 2 == 0) is bool(held)
            np.testing.assert_array_equal(frame[f"pressure.{FINGERS[1]}"], pressure[1])
            assert (frame["hand"], frame[f"sensor.{FINGERS[2]}"]) == ("unknown", "gel_16mm")
    assert max(force) > 1


def test_frames_invent_no_forces_where_no_gel_is_elastic(data):
    columns = GraspFrames(data).columns
    assert not [name for name in columns if name.startswith(("force", "pressure", "held"))]


def test_webdataset_names_unit_and_joints_of_each_column(elastic, tmp_path):
    vt("export", elastic, tmp_path / "out", "--to", "webdataset")
    described = json.loads((tmp_path / "out" / "columns.json").read_text())
    assert described["joint_angles"]["names"] == [f"joint-{number}" for number in range(16)]
    assert described[f"pressure.{FINGERS[0]}"]["unit"] == "Pa"
    files = files_in(tmp_path / "out" / "test-000000.tar")
    facts = json.loads(files["00000001.json"])
    assert facts.keys() == {name for name, column in described.items() if not column["shape"]}
    force = ObjectRows(elastic, ["force"], split=None).read("force", facts["object_id"], 1)
    assert np.float32(facts[f"force.{FINGERS[0]}"]) == force[0]


def test_webdataset_shards_are_cut_by_size_between_samples(data, tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.contrib.exports.webdataset_shards.SHARD_BYTES", 1)
    vt("export", data, tmp_path / "out", "--to", "webdataset")
    shards = sorted((tmp_path / "out").glob("*.tar"))
    assert [shard.name for shard in shards] == [f"test-{number:06d}.tar" for number in range(10)]
    keys = [{name.partition(".")[0] for name in files_in(shard)} for shard in shards]
    assert keys == [{f"{number:08d}"} for number in range(10)]


def test_folder_that_is_not_empty_is_refused(data, tmp_path):
    (tmp_path / "mine").write_text("")
    assert "is not empty" in vt("export", data, tmp_path, "--to", "webdataset", fails=True)
    assert "mine is a file; name a folder that is not there yet" in vt("export", data, tmp_path / "mine", fails=True)


def test_unsupported_format_writes_nothing(data, tmp_path):
    assert "duck.obj is named like a .obj file" in vt("export", data, tmp_path / "duck.obj", "--object", "a", fails=True)
    assert not (tmp_path / "duck.obj").exists()


def export_names(data, folder: Path) -> str:
    (folder / "names.txt").write_text("\n".join(ObjectRows(data, ["points"], split=None).object_ids))
    return "2 names"


def test_exports_of_other_packages_are_written(data, tmp_path, monkeypatch):
    entry = EntryPoint("names", f"{__name__}:export_names", "vt_pipeline.exports")
    monkeypatch.setattr("pipeline.plugins.declared", lambda group: (entry,))
    assert f"{tmp_path / 'out'}: 2 names" in vt("export", data, tmp_path / "out", "--to", "names")
    assert (tmp_path / "out" / "names.txt").read_text() == "a\nb"
    assert "unknown export mesh; choose from names" in vt("export", data, tmp_path / "other", fails=True)


def test_object_option_is_refused_by_tables(data, tmp_path):
    refused = vt("export", data, tmp_path / "out", "--to", "webdataset", "--object", "a", fails=True)
    assert "--object is no option of --to webdataset" in refused


@pytest.mark.skipif(importlib.util.find_spec("pyarrow") is not None, reason="pyarrow is installed")
def test_missing_pyarrow_is_named_with_the_command_that_installs_it(data, tmp_path):
    assert "pip install -c constraints.txt -e '.[export]'" in vt("export", data, tmp_path / "out", "--to", "parquet", fails=True)


@pytest.mark.parametrize("block", [1, 2**22])
def test_lerobot_statistics_are_those_of_numpy_over_all_finite_values(tmp_path, monkeypatch, block):
    monkeypatch.setattr("pipeline.contrib.exports.lerobot_files.BLOCK", block)
    rng = np.random.default_rng(0)
    depth = rng.normal(size=(37, 2, 3)).astype(np.float32)
    depth[::3, 0, 1], depth[:, 1, 2] = np.inf, np.inf
    images, grasps = rng.integers(0, 200, (37, 8, 9, 3), np.uint8), np.arange(37) % 5
    columns = {"depth": Column("float32", (2, 3)), "image": Column("image", (8, 9, 3)), "grasp": Column("int64"), "split": Column("string")}
    with (tmp_path / "numbers").open("w+b") as file:
        statistics = _Statistics(columns, file)
        for number in range(37):
            statistics.update({"depth": depth[number], "image": images[number], "grasp": grasps[number], "split": "test"})
        summary = statistics.summary()
    assert summary.keys() == {"depth", "image", "grasp"}
    for name, values in {"depth": np.where(np.isfinite(depth), depth, np.nan), "image": images / 255, "grasp": grasps[:, None]}.items():
        axes, shape = ((0, 1, 2), (3, 1, 1)) if name == "image" else (0, values.shape[1:])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the pixel without a finite depth
            expected = {key: np.nanquantile(values, share, axis=axes, method="linear") for key, share in QUANTILES.items()}
            expected |= {"mean": np.nanmean(values, axis=axes, dtype=float), "std": np.nanstd(values, axis=axes, dtype=float)}
        assert summary[name].pop("count") == [37]
        assert summary[name].keys() == expected.keys()
        for key, value in expected.items():
            np.testing.assert_allclose(summary[name][key], np.nan_to_num(value).reshape(shape), rtol=1e-6, atol=1e-7, err_msg=key)


def test_killed_export_is_started_again_by_the_next(data, tmp_path):
    unfinished = tmp_path / "out" / ".unfinished" / "files"
    unfinished.mkdir(parents=True)
    (unfinished / "test-000000.tar").write_text("half")
    (unfinished / "test-000009.tar").write_text("half")
    vt("export", data, tmp_path / "out", "--to", "webdataset")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"columns.json", "test-000000.tar"}
    assert files_in(tmp_path / "out" / "test-000000.tar")


def test_failed_export_leaves_nothing_and_names_the_folder(data, tmp_path, monkeypatch):
    def fails(shard, *_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("pipeline.contrib.exports.webdataset_shards._add_sample", fails)
    assert f"No space left on device: '{tmp_path / 'out'}'" in vt("export", data, tmp_path / "out", "--to", "webdataset", fails=True)
    assert not (tmp_path / "out").exists()


def test_second_export_into_a_folder_is_refused_while_the_first_is_at_work(tmp_path):
    with atomic_writes(tmp_path / "out") as folder:
        (folder / "a").write_text("first")
        with pytest.raises(StoreError, match="out is being made by another run"), atomic_writes(tmp_path / "out"):
            pass
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["a"]


@pytest.mark.parametrize("name", ["a", "b", ".unfinished"])
def test_export_is_not_written_through_links_in_its_folder(tmp_path, name):
    (tmp_path / "out").mkdir()
    (tmp_path / "v").mkdir()
    (tmp_path / "out" / name).symlink_to(tmp_path / "v")

    def write() -> None:
        with atomic_writes(tmp_path / "out") as folder:
            (folder / "a").mkdir()
            for file in ("a/one", "b"):
                (folder / file).write_text("ours")

    with pytest.raises(StoreError, match=f"{name} is a symbolic link to .*; nothing is written through links"):
        write()
    assert not [*(tmp_path / "v").iterdir()]


def test_export_into_a_linked_folder_is_written(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    with atomic_writes(tmp_path / "out") as folder:
        (folder / "a").write_text("ours")
    assert (tmp_path / "disk" / "a").read_text() == "ours"
