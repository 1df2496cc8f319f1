"""Exports read back by the libraries they are for are equal; `make test-exports` runs this file.

The file's name keeps it from being collected by `make test`: LeRobot, `datasets` and WebDataset are installed for this alone.
"""

import importlib.util
import json
import subprocess
import sys
import types
from pathlib import Path

import datasets
import mlcroissant
import numpy as np
import pytest
import torch
import webdataset

from pipeline.dataset.object_rows import ObjectRows
from tests.contrib.exports.test_exports import FINGERS, vt
from tests.contrib.exports.test_exports import elastic as data  # noqa: F401
from tests.contrib.exports.test_sequence_frames import LIFT_STEPS, RATE, SLIDES, STEPS, lifts  # noqa: F401
from tests.contrib.exports.test_sequence_frames import data as slides  # noqa: F401


class ToTensor:
    """Stand-in for torchvision's class, which does not load with this torch: (H, W, C) uint8 to (C, H, W) float32, 0 to 1."""

    def __call__(self, image):
        return torch.from_numpy(np.asarray(image).copy()).permute(2, 0, 1).float() / 255


@pytest.fixture
def lerobot(monkeypatch):
    """Return LeRobot's dataset class: of its newest version where this Python has it, else of 0.4.4."""
    if importlib.util.find_spec("torchvision") is None:
        stand_in_for_torchvision(monkeypatch)
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset


def stand_in_for_torchvision(monkeypatch):
    stand_in = types.ModuleType("torchvision")
    stand_in.transforms = types.SimpleNamespace(ToTensor=ToTensor, v2=types.SimpleNamespace(Transform=object))
    for name, module in (("torchvision", stand_in), ("torchvision.transforms", stand_in.transforms)):
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setitem(sys.modules, "torchvision.transforms.v2", stand_in.transforms.v2)


@pytest.fixture
def stored(data) -> ObjectRows:  # noqa: F811
    arrays = ["tactile_image", "depth", "pressure", "force", "touch_success", "held", "joint_angles", "hand_pose", "sensor_pose"]
    return ObjectRows(data, arrays, split=None)


def check(stored: ObjectRows, object_id: str, grasp: int, arrays: dict[str, object], *, single: bool = False) -> None:
    """Compare the arrays of a frame with the stored ones; `single` converts float64 to float32 first, as LeRobot does."""
    for name, value in arrays.items():
        array, _, finger = name.partition(".")
        expected = stored.read(array, object_id, grasp)
        expected = expected[FINGERS.index(finger)] if finger else expected
        if single and expected.dtype == np.float64:
            expected = expected.astype(np.float32)
        np.testing.assert_array_equal(np.asarray(value, expected.dtype), expected, err_msg=name)


def test_lerobot_reads_frames_equal_to_the_stored_ones(lerobot, data, stored, tmp_path):  # noqa: F811
    vt("export", data, tmp_path / "out", "--to", "lerobot")
    dataset = lerobot("vt/balls", root=tmp_path / "out", video_backend="pyav")
    assert (dataset.num_episodes, dataset.num_frames, dataset.fps) == (2, 10, 1)
    assert json.loads((tmp_path / "out" / "meta" / "info.json").read_text())["splits"] == {"test": "0:2"}
    assert set(dataset.meta.stats) >= {"observation.state", f"observation.images.tactile_{FINGERS[0]}"}
    units = {"observation.force_": "N", "observation.pressure_": "Pa", "observation.depth_": "m"}
    for name, unit in units.items():
        assert {dataset.features[f"{name}{finger}"]["unit"] for finger in FINGERS} == {unit}
    for number in (0, 4, 9):
        item = dataset[number]
        image = item[f"observation.images.tactile_{FINGERS[1]}"]
        arrays = {
            "touch_success": item["observation.touch_success"],
            "joint_angles": item["observation.state"],
            "hand_pose": item["observation.hand_pose"],
            "sensor_pose": item["observation.sensor_pose"],
            f"depth.{FINGERS[1]}": item[f"observation.depth_{FINGERS[1]}"],
            f"tactile_image.{FINGERS[1]}": (255 * image).round().permute(1, 2, 0),
            f"pressure.{FINGERS[2]}": item[f"observation.pressure_{FINGERS[2]}"],
            **{f"force.{finger}": item[f"observation.force_{finger}"] for finger in FINGERS},
            "held": item["held"],
        }
        check(stored, item["object_id"], int(item["grasp"]), arrays, single=True)
        assert (item["hand"], item[f"sensor.{FINGERS[0]}"]) == ("unknown", "gel_16mm")
        assert item["task"] == f"grasp {'an' if item['category'] == 'object' else 'a'} {item['category']}"


def test_lerobot_statistics_have_the_names_shapes_and_values_of_its_own(lerobot, data, tmp_path):  # noqa: F811
    from lerobot.datasets.compute_stats import get_feature_stats

    vt("export", data, tmp_path / "out", "--to", "lerobot")
    dataset = lerobot("vt/balls", root=tmp_path / "out", video_backend="pyav")
    items = [dataset[number] for number in range(dataset.num_frames)]
    force = f"observation.force_{FINGERS[1]}"
    widest = float(np.diff(np.sort([float(item[force]) for item in items])).max())
    for name, axes, gap in ((f"observation.images.tactile_{FINGERS[0]}", (0, 2, 3), 1 / 255), ("grasp", 0, 1), (force, 0, widest)):
        own = get_feature_stats(np.stack([item[name].numpy() for item in items]).astype(np.float64), axes, keepdims=True)
        own = {key: value[0] if value.ndim > 1 else value for key, value in own.items()}
        ours = dataset.meta.stats[name]
        assert {key: value.shape for key, value in ours.items()} == {key: value.shape for key, value in own.items()}
        for key, value in own.items():  # its quantiles are those of a histogram: between the same two values as ours
            np.testing.assert_allclose(ours[key], value, rtol=0, atol=1.001 * gap if key.startswith("q") else 1e-6, err_msg=key)


@pytest.fixture
def exported(data, tmp_path) -> Path:  # noqa: F811
    about = {"creators": ["A. Person"], "url": "https://example.org", "licence": "https://spdx.org/licenses/CC0-1.0"}
    (tmp_path / "about.yaml").write_text(json.dumps(about | {"published": "2026-11-26"}))
    vt("export", data, tmp_path / "out", "--to", "parquet", "--about", tmp_path / "about.yaml")
    return tmp_path / "out"


@pytest.mark.filterwarnings("ignore")  # warnings of its libraries
def test_croissant_is_valid_and_reads_rows_equal_to_the_stored_ones(exported, stored):
    dataset = mlcroissant.Dataset(exported / "croissant.json")
    issues = dataset.metadata.ctx.issues
    assert (issues.errors, issues.warnings) == (set(), set())
    records = list(dataset.records("test"))
    assert len(records) == 10
    for record in records:
        row = {name.partition("/")[2]: value for name, value in record.items()}
        arrays = {name: value for name, value in row.items() if name.partition(".")[0] in stored.arrays}
        check(stored, row["object_id"].decode(), row["grasp"], arrays)


def test_hugging_face_reads_rows_equal_to_the_stored_ones(exported, stored, tmp_path):
    read = datasets.load_dataset(str(exported), cache_dir=str(tmp_path / "cache"))
    assert {split: len(rows) for split, rows in read.items()} == {"test": 10}
    for row in read["test"]:
        check(
            stored, row["object_id"], row["grasp"], {name: value for name, value in row.items() if name.partition(".")[0] in stored.arrays}
        )


def test_hugging_face_rounds_in_its_formats_as_the_card_says(exported, stored, tmp_path):
    rows = datasets.load_dataset(str(exported), cache_dir=str(tmp_path / "cache"))["test"]
    pose = stored.read("hand_pose", rows[0]["object_id"], rows[0]["grasp"])
    for form in ("numpy", "torch"):
        rounded = np.asarray(rows.with_format(form)[0]["hand_pose"])
        assert rounded.dtype == np.float32
        np.testing.assert_array_equal(rounded, pose.astype(np.float32))
    np.testing.assert_array_equal(rows.with_format("numpy", dtype=np.float64)[0]["hand_pose"], pose)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # it does not close its files
def test_webdataset_reads_samples_equal_to_the_stored_ones(data, stored, tmp_path):  # noqa: F811
    vt("export", data, tmp_path / "out", "--to", "webdataset")
    samples = list(webdataset.WebDataset(str(tmp_path / "out" / "test-000000.tar"), shardshuffle=False).decode("rgb8"))
    assert len(samples) == 10
    for sample in samples:
        facts = sample["json"]
        arrays = {name: sample[f"{name}.npy"] for name in ("touch_success", "joint_angles", "hand_pose", "sensor_pose")}
        arrays |= {f"depth.{finger}": sample[f"depth_{finger}.npy"] for finger in FINGERS}
        arrays |= {f"tactile_image.{finger}": sample[f"tactile_image_{finger}.png"] for finger in FINGERS}
        arrays |= {f"pressure.{finger}": sample[f"pressure_{finger}.npy"] for finger in FINGERS}
        arrays |= {name: facts[name] for name in ("held", *(f"force.{finger}" for finger in FINGERS))}
        check(stored, facts["object_id"], facts["grasp"], arrays)


def stored_step(slides: Path, name: str, frame: dict) -> np.ndarray:  # noqa: F811
    rows = ObjectRows(slides, [f"slide_{name}"], split=None)
    return rows.read(f"slide_{name}", frame["object_id"], int(frame["slide"]))[int(frame["step"])]


def test_lerobot_reads_slides_as_episodes_in_their_time(lerobot, slides, tmp_path):  # noqa: F811
    vt("export", slides, tmp_path / "out", "--to", "lerobot", "--of", "slides")
    window = {"observation.force_gelsight": [-0.25, 0.0]}
    dataset = lerobot("vt/slides", root=tmp_path / "out", video_backend="pyav", delta_timestamps=window)
    assert (dataset.num_episodes, dataset.num_frames, dataset.fps) == (2 * SLIDES, 2 * SLIDES * STEPS, 4)
    for number in (0, 3, STEPS + 4, 2 * SLIDES * STEPS - 1):
        item = dataset[number]
        assert float(item["timestamp"]) == int(item["step"]) / 4
        before = dict(item) | {"step": max(int(item["step"]) - 1, 0)}  # the episode's first where there is none
        forces = [stored_step(slides, "force", before), stored_step(slides, "force", item)]
        np.testing.assert_array_equal(item["observation.force_gelsight"].numpy(), forces)
        np.testing.assert_array_equal(item["observation.shear_gelsight"].numpy(), stored_step(slides, "shear", item))
        image = (255 * item["observation.images.tactile_gelsight"]).round().permute(1, 2, 0).numpy()
        np.testing.assert_array_equal(image, stored_step(slides, "tactile_image", item))
        assert item["task"] == "slide over a bottle"


def test_lerobot_reads_lifts_as_episodes_with_the_hand(lerobot, lifts, tmp_path):  # noqa: F811
    vt("export", lifts, tmp_path / "out", "--to", "lerobot", "--of", "lifts")
    window = {"observation.force_thumb": [-1 / RATE, 0.0]}
    dataset = lerobot("vt/lifts", root=tmp_path / "out", video_backend="pyav", delta_timestamps=window)
    assert (dataset.num_episodes, dataset.num_frames, dataset.fps) == (2, 2 * LIFT_STEPS, RATE)
    rows = ObjectRows(lifts, ["lift_force", "lift_shear", "lift_weight", "joint_angles"], split=None)
    thumb = 3
    for number in (0, 3, 2 * LIFT_STEPS - 1):
        item = dataset[number]
        object_id, step = item["object_id"], int(item["step"])
        force = rows.read("lift_force", object_id, 0)[thumb]
        np.testing.assert_array_equal(item["observation.force_thumb"].numpy(), force[[max(step - 1, 0), step]])
        np.testing.assert_array_equal(item["observation.shear_thumb"].numpy(), rows.read("lift_shear", object_id, 0)[thumb, step])
        np.testing.assert_array_equal(float(item["weight"]), rows.read("lift_weight", object_id, 0)[step])
        np.testing.assert_array_equal(item["observation.state"].numpy(), rows.read("joint_angles", object_id, 0).astype(np.float32))
        assert item["task"] == "lift a bottle"


def test_hugging_face_reads_steps_of_slides(slides, tmp_path):  # noqa: F811
    vt("export", slides, tmp_path / "out", "--to", "parquet", "--of", "slides")
    read = datasets.load_dataset(str(tmp_path / "out"), cache_dir=str(tmp_path / "cache"))
    assert sum(len(rows) for rows in read.values()) == 2 * SLIDES * STEPS
    for rows in read.values():
        for row in rows.select([2, STEPS + 5]):
            for name in ("force", "shear", "pose", "slip_share"):
                stored = stored_step(slides, name, row)
                np.testing.assert_array_equal(np.asarray(row[f"{name}.gelsight"], stored.dtype), stored)
            np.testing.assert_array_equal(np.asarray(row["tactile_image.gelsight"]), stored_step(slides, "tactile_image", row))


@pytest.mark.skipif(sys.version_info < (3, 12), reason="tacstack needs Python 3.12")
def test_tacstack_reads_shear_and_force_of_slides(slides, tmp_path):  # noqa: F811
    from tacstack.adapters.open_x_tactile import OpenXTactileAdapter

    vt("export", slides, tmp_path / "out", "--to", "oxt", "--of", "slides")
    for split, object_id in (("train", "bottle-0000"), ("valid", "bottle-0001")):
        rows = ObjectRows(slides, ["slide_force", "slide_pressure"], split=None)
        for quantity in ("force", "pressure"):
            adapter = OpenXTactileAdapter(tmp_path / "out" / split, task="slide_bottle", stream=f"right_{quantity}_gelsight")
            adapter.open()
            for step in range(STEPS):
                expected = rows.read(f"slide_{quantity}", object_id, 0)[step]
                np.testing.assert_array_equal(adapter.read().taxels.reshape(expected.shape), expected)


@pytest.mark.skipif(sys.version_info < (3, 12), reason="tacstack needs Python 3.12")
def test_tacstack_makes_mcap_rerun_and_lerobot_of_forces(lerobot, data, stored, tmp_path):  # noqa: F811
    from mcap.reader import make_reader
    from tacstack.adapters.open_x_tactile import OpenXTactileAdapter
    from tacstack.integrations.lerobot import LeRobotDatasetWriter

    vt("export", data, tmp_path / "out", "--to", "oxt")
    writer = LeRobotDatasetWriter(tmp_path / "lerobot", fps=1, feature_key="observation.force")
    tasks = dict(zip(stored.object_ids, ("grasp_bottle", "grasp_knife"), strict=True))
    for object_id, task in tasks.items():
        for quantity in ("pressure", "force"):
            adapter = OpenXTactileAdapter(tmp_path / "out" / "test", task=task, stream=f"right_{quantity}_gel_16mm")
            adapter.open()
            observations = [adapter.read() for _ in range(5)]
            for grasp, observation in enumerate(observations):
                expected = stored.read(quantity, object_id, grasp)
                np.testing.assert_array_equal(observation.taxels.reshape(expected.shape), expected)
                assert observation.metadata["oxt_tactile_areas"] == (1, 2, 3, 0)
        for observation in observations:
            observation.taxels = observation.taxels.ravel()  # it writes one dimension
        writer.add_episode(observations, task=task)
        source = [str(tmp_path / "out" / "test"), "--task", task, "--stream", "right_force_gel_16mm", "--out"]
        for command, name in (("dataset convert", "force.mcap"), ("replay", "force.rrd")):
            subprocess.run([sys.executable, "-m", "tacstack", *command.split(), *source, str(tmp_path / name)], check=True)
        with (tmp_path / "force.mcap").open("rb") as file:
            assert len([*make_reader(file).iter_messages()]) == 5
        assert (tmp_path / "force.rrd").stat().st_size > 1000
    writer.finalize()
    dataset = lerobot("vt/forces", root=tmp_path / "lerobot", video_backend="pyav")
    forces = [item["observation.force"].numpy() for item in dataset]
    np.testing.assert_array_equal(forces, np.concatenate([stored.read("force", object_id) for object_id in tasks]))
