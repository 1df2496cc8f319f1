"""Slides and lifts as frames: an episode per sequence, a frame per step, columns as stored; and Open-X-Tactile's stores of them."""

import io
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from pipeline.contrib.exports.sequence_frames import LiftFrames, SlideFrames, open_frames
from pipeline.dataset.object_rows import ObjectRows
from schemas.presses import PRESSED
from tests.command_line import vt
from tests.contrib.exports.test_exports import files_in
from tests.stages.lifted_objects import RATE, make_lifts
from tests.stages.lifted_objects import STEPS as LIFT_STEPS
from tests.stages.tiny_dataset import manifest, run_stage

SLIDES, STEPS = 2, 8
SMALL = [f"simulate-slides.{text}" for text in (f"slides={SLIDES}", f"steps={STEPS}", "rate=4", "pixels=32")]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """Return a dataset of slides alone, of two objects."""
    folder = tmp_path_factory.mktemp("slides")
    for stage in ("sample-surfaces", "simulate-slides"):
        run_stage(folder, stage, manifest(), *SMALL)
    return folder


@pytest.fixture(scope="module")
def lifts(tmp_path_factory) -> Path:
    """Return a dataset of lifts, a grasp of each of two objects."""
    folder = tmp_path_factory.mktemp("lifts")
    make_lifts(folder)
    return folder


def test_frames_are_the_steps_of_each_slide_as_stored(data):
    frames = open_frames(data)  # there are no grasps
    assert isinstance(frames, SlideFrames)
    assert (frames.fps, frames.hand, frames.summary) == (4.0, "gelsight", f"{2 * SLIDES} slides")
    units = {name: frames.columns[f"{name}.gelsight"].unit for name in ("shear", "force", "torque", "pressure", "slip")}
    assert units == {"shear": "m", "force": "N", "torque": "N m", "pressure": "Pa", "slip": "m"}
    arrays = ["shear", "force", "slip_share", "gross_slip", "tactile_image", "pose", "time"]
    rows = ObjectRows(data, [f"slide_{name}" for name in (*arrays, "shape", "friction")], split=None)
    episodes = list(frames.episodes())
    assert len(episodes) == 2 * SLIDES
    for _, episode in episodes:
        object_id, slide = episode[0]["object_id"], episode[0]["slide"]
        assert [frame["step"] for frame in episode] == list(range(STEPS))
        assert {frame["shape"] for frame in episode} == {PRESSED[int(rows.read("slide_shape", object_id, slide))]}
        assert episode[3]["friction"] == float(rows.read("slide_friction", object_id, slide))
        for name in arrays:
            stored = rows.read(f"slide_{name}", object_id, slide)
            column = name if name == "time" else f"{name}.gelsight"
            np.testing.assert_array_equal(np.stack([frame[column] for frame in episode]), stored, err_msg=name)
        assert set(episode[0]) == set(frames.columns)


def test_webdataset_has_a_sample_per_step(data, tmp_path):
    assert f"{2 * SLIDES} slides" in vt("export", data, tmp_path / "out", "--to", "webdataset", "--of", "slides")
    files = files_in(tmp_path / "out" / "train-000000.tar")
    assert len([name for name in files if name.endswith(".json")]) == SLIDES * STEPS
    facts = json.loads(files[f"{STEPS + 3:08d}.json"])
    assert (facts["slide"], facts["step"]) == (1, 3)
    stored = ObjectRows(data, ["slide_shear"], split=None).read("slide_shear", facts["object_id"], 1)[3]
    np.testing.assert_array_equal(np.load(io.BytesIO(files[f"{STEPS + 3:08d}.shear_gelsight.npy"])), stored)


def test_open_x_tactile_has_an_episode_per_slide_and_no_hand(data, tmp_path):
    vt("export", data, tmp_path / "out", "--to", "oxt")
    rows = ObjectRows(data, ["slide_force", "slide_shear", "slide_slip_share", "slide_tactile_image"], split=None)
    stores = sorted((tmp_path / "out").rglob("slide_bottle.zarr"))
    assert len(stores) == 2  # one of each split
    for path in stores:
        root: Any = zarr.open_group(str(path), mode="r")
        stored = root["data"]
        (object_id,) = set(stored["object_id"][:])
        assert root["meta/episode_ends"][:].tolist() == [STEPS, 2 * STEPS]
        assert stored["timestamps"][:].tolist() == 2 * [step / 4 for step in range(STEPS)]
        assert set(stored["sub_task_instruction"][:]) == {"slide over a bottle"}
        for quantity, kind, array in (("force", "state", "force"), ("shear", "matrix", "shear"), ("image", "image", "tactile_image")):
            expected = np.concatenate(rows.read(f"slide_{array}", object_id))[:, None]
            np.testing.assert_array_equal(stored[f"right_tactile_data_{quantity}_gelsight"][:], expected)
            assert set(stored[f"right_tactile_type_{quantity}_gelsight"][:]) == {kind}
        share = stored["right_tactile_data_slip_share_gelsight"]
        assert share.shape == (2 * STEPS, 1, 1)
        assert not [name for name in stored if "joint" in name or "wrist" in name]


def test_what_frames_are_must_be_known_and_made(data, tmp_path):
    assert "unknown kind of frames slide, did you mean slides?" in vt(
        "export", data, tmp_path / "out", "--to", "oxt", "--of", "slide", fails=True
    )
    assert "grasps has not been made" in vt("export", data, tmp_path / "out", "--to", "oxt", "--of", "grasps", fails=True)
    assert "--of is no option of --to grasps" in vt("export", data, tmp_path / "out", "--to", "grasps", "--of", "slides", fails=True)


def test_frames_of_lifts_are_the_steps_of_each_grasp_as_stored(lifts):
    frames = open_frames(lifts, "lifts")
    assert isinstance(frames, LiftFrames)
    assert (frames.fps, frames.hand, frames.summary) == (RATE, "allegro_right", "2 lifts")
    arrays = ("force", "shear", "slip_share", "tactile_image", "pose")
    rows = ObjectRows(lifts, [*(f"lift_{name}" for name in (*arrays, *LiftFrames.others, "time")), "joint_angles", "hand_pose"], split=None)
    episodes = [episode for _, episode in frames.episodes()]
    assert len(episodes) == 2
    for episode in episodes:
        object_id = episode[0]["object_id"]
        assert [frame["step"] for frame in episode] == list(range(LIFT_STEPS))
        assert set(episode[0]) == set(frames.columns)
        for finger, name in enumerate(frames.labels["sensor"]):
            assert episode[0][f"sensor.{name}"] == "gel_16mm"
            for array in arrays:
                stored = rows.read(f"lift_{array}", object_id, 0)[finger]
                np.testing.assert_array_equal(np.stack([frame[f"{array}.{name}"] for frame in episode]), stored, err_msg=array)
        for array in LiftFrames.others:
            np.testing.assert_array_equal(np.stack([frame[array] for frame in episode]), rows.read(f"lift_{array}", object_id, 0))
        assert [frame["time"] for frame in episode] == rows.read("lift_time", object_id, 0)[0].tolist()
        for frame in (episode[0], episode[-1]):
            for array in LiftFrames.of_grasp:
                np.testing.assert_array_equal(frame[array], rows.read(array, object_id, 0))


def test_lerobot_has_an_episode_per_lift_in_its_time(lifts, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    assert "2 lifts" in vt("export", lifts, tmp_path / "out", "--to", "lerobot", "--of", "lifts")
    info = json.loads((tmp_path / "out" / "meta" / "info.json").read_text())
    assert (info["fps"], info["total_episodes"], info["total_frames"], info["robot_type"]) == (RATE, 2, 2 * LIFT_STEPS, "allegro_right")
    assert info["features"]["observation.force_thumb"]["unit"] == "N"
    assert info["features"]["observation.state"]["shape"] == [16]
    table = parquet.read_table(tmp_path / "out" / "data" / "chunk-000" / "file-000.parquet")
    assert table["timestamp"].to_pylist() == [step / RATE for step in range(LIFT_STEPS)] * 2


def test_open_x_tactile_has_an_episode_per_lift_with_the_hand(lifts, tmp_path):
    vt("export", lifts, tmp_path / "out", "--to", "oxt", "--of", "lifts")
    rows = ObjectRows(lifts, ["lift_force", "lift_held", "joint_angles"], split=None)
    stores = sorted((tmp_path / "out").rglob("lift_bottle.zarr"))
    assert len(stores) == 2  # one of each split
    for path in stores:
        root: Any = zarr.open_group(str(path), mode="r")
        stored = root["data"]
        (object_id,) = set(stored["object_id"][:])
        assert root["meta/episode_ends"][:].tolist() == [LIFT_STEPS]
        assert stored["timestamps"][:].tolist() == [step / RATE for step in range(LIFT_STEPS)]
        assert set(stored["sub_task_instruction"][:]) == {"lift a bottle"}
        force = np.swapaxes(rows.read("lift_force", object_id, 0), 0, 1)  # (step, sensor, 3)
        np.testing.assert_array_equal(stored["right_tactile_data_force_gel_16mm"][:], force)
        np.testing.assert_array_equal(stored["held"][:], rows.read("lift_held", object_id, 0))
        np.testing.assert_array_equal(stored["right_hand_joints"][:], np.tile(rows.read("joint_angles", object_id, 0), (LIFT_STEPS, 1)))


def test_a_dataset_without_lifts_says_how_to_make_them(lifts, tmp_path):
    for name in ("surfaces", "grasps"):
        shutil.copytree(lifts / name, tmp_path / "data" / name)
    shutil.copy(lifts / "dataset.json", tmp_path / "data")
    assert "touch has not been made" in vt("export", tmp_path / "data", tmp_path / "out", "--to", "oxt", "--of", "lifts", fails=True)
