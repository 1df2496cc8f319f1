"""Sockets, devices and links to them in a dataset are never opened; each gives a clear error."""

import os
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from pipeline.dataset.labelled import open_artifact
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StoreError
from pipeline.models.model_files import read_weights
from pipeline.store.directory import DataDirectory
from pipeline.store.shard import RowView
from pipeline.store.validate import problems_below
from pipeline.tables.status import read_account
from pipeline.training import checkpoint
from schemas.surfaces import SURFACES
from stages.evaluate.evaluation_files import read_root, read_table, write_evaluation
from tests.stages import ball_dataset


@pytest.fixture(scope="module")
def original(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    ball_dataset.make_data(folder, 1)
    for name in ("grasps", "vision", "touch", "distances", "charts"):
        shutil.rmtree(folder / name)
    ball_dataset.make_model(folder, "touch")
    return folder


@pytest.fixture
def data(original, tmp_path) -> Path:
    return Path(shutil.copytree(original, tmp_path / "data"))


def socket(path: Path) -> None:
    os.mknod(path, stat.S_IFSOCK | 0o600)


def link_to_device(path: Path) -> None:
    path.symlink_to("/dev/null")


def link_to_itself(path: Path) -> None:
    path.symlink_to(path.name)


IRREGULAR = (link_to_itself, socket, link_to_device)

FILES = [
    "dataset.json",
    "surfaces/0000-of-0001.json",
    "surfaces/*.zarr/zarr.json",
    "surfaces/*.zarr/points/zarr.json",
    "surfaces/*.zarr/points/c/0/0/0",
    "surfaces/*.zarr/meshes/a/vertices/zarr.json",
    "surfaces/*.zarr/meshes/a/vertices/c/0/0",
    "models/gcn/touch.json",
    "models/gcn/touch-*/model.safetensors",
]


@pytest.mark.parametrize("name", FILES)
def test_dataset_with_a_socket_device_or_link_in_place_of_a_file_is_invalid(data, name: str):
    (path,) = data.glob(name)
    for put in IRREGULAR:
        path.unlink(missing_ok=True)
        put(path)
        assert any(lines for lines in problems_below(data).values())
        read_account(data)
    if name.startswith("models"):
        with pytest.raises(StoreError):
            DataDirectory(data).verified_folder("models/gcn/touch")
    else:
        with pytest.raises(StoreError):
            DataDirectory(data).collection(SURFACES).view("a").verify()
    if "points" in name or "-of-" in name:
        for read in (lambda: ObjectRows(data, ["points"], None).read("points", "a"), lambda: open_artifact(data, "surfaces")):
            with pytest.raises(StoreError):
                read()


def test_chunk_replaced_by_a_socket_or_device_while_open_gives_an_error(data):
    shard = DataDirectory(data).collection(SURFACES).first
    shard.stored("points")
    path = shard.path / "points" / "c" / "0" / "0" / "0"
    for put in IRREGULAR:
        path.unlink()
        put(path)
        with pytest.raises(StoreError, match=r"points of a cannot be read \(.*it is not a regular file: '.*points/c/0/0/0'\); .* --check"):
            RowView(shard, "a")["points"]


@pytest.mark.parametrize("put", [socket, link_to_device])
def test_sockets_and_devices_in_unrecorded_files_are_refused(tmp_path, put: Callable[[Path], None]):
    facts = {
        "settings": {"points": 1, "scale": 1.0},
        "seed": 0,
        "paper_sizes": True,
        "split": "test",
        "configurations": {"none": {"touch": False}},
        "left_out": {},
        "training_objects": 0,
    }
    write_evaluation(tmp_path, {}, facts)
    assert read_root(tmp_path)["seed"] == 0
    (tmp_path / "tables.zarr" / "zarr.json").unlink()
    put(tmp_path / "tables.zarr" / "zarr.json")
    with pytest.raises(StoreError, match="cannot be read as an evaluation"):
        read_table(tmp_path, "table_2")
    put(tmp_path / "model.safetensors")
    with pytest.raises(StoreError, match="no trained model that can be used"):
        read_weights(tmp_path)
    put(tmp_path / checkpoint.FILE)
    module = torch.nn.Linear(1, 1)
    with pytest.raises(OSError, match="it is not a regular file"):
        checkpoint.load(tmp_path, module, torch.optim.Adam(module.parameters()))
