"""`read-grasps`: grasps that this project exports come back the same, other files' grasps one by one."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from pipeline.console import errors
from pipeline.contrib.exports.grasp_frames import GraspFrames
from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.make import make
from pipeline.engine.plan import Made, Request
from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.recipes.dataset_recipe import recipe_of
from pipeline.tables.touch_tables import read_touches
from stages.registry import load_stage, resolve
from tests.command_line import vt
from tests.stages.tiny_dataset import ASSIGNMENTS, manifest, run_stage

NAME, GRASPS = "bottle-0000", 2
ASSETS = Path(__file__).parents[3] / "pipeline" / "assets"
GEL = {"modulus": 2e5, "poisson": 0.3}
ALL_ARRAYS = ("hand_pose", "joint_angles", "pregrasp_angles", "squeeze_angles", "sensor_pose", "contact_point", "contact_area", "closure")
TOUCHES = ("depth", "tactile_image", "pressure", "force")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Grasp a bottle twice, and simulate the touches."""
    folder = tmp_path_factory.mktemp("simulated")
    coarse = yaml.safe_load((ASSETS / "sensors" / "gel_16mm.yaml").read_text()) | {"rows": 20, "cols": 20, "gel": GEL}
    (folder / "coarse.yaml").write_text(yaml.safe_dump(coarse))
    for name in ("sample-surfaces", "simulate-grasps", "simulate-touch"):
        run_stage(folder, name, manifest(1, 0), f"simulate-grasps.grasps={GRASPS}", f"sensor={folder}/coarse.yaml")
    return folder


def run_on(data: Path, folder: Path, *assignments: str) -> Made:
    """Read grasps in place of those of a dataset."""
    chosen = [*ASSIGNMENTS, f"sensor={data}/coarse.yaml", f"read-grasps.folder={folder}", f"read-grasps.grasps={GRASPS}", *assignments]
    settings, objects = resolve("read-grasps", "draft", chosen), manifest(1, 0)
    (made,) = make(Request(load_stage("read-grasps"), settings, objects.name, objects.objects(), "draft", 0, data), errors)
    return made


@pytest.fixture
def copy(data: Path, tmp_path: Path) -> Path:
    """Copy the dataset, whose grasps are to be replaced."""
    return Path(shutil.copytree(data, tmp_path / "copy"))


@pytest.mark.parametrize("form", ["grasps", "dexgraspbench"])
def test_exported_grasps_come_back_with_the_same_touches(form, data, copy, tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.contrib.exports.grasp_files.convex_parts", lambda mesh: [mesh.vertices])  # which takes minutes
    vt("export", data, tmp_path / "out", "--to", form)
    folder = tmp_path / "out" if form == "grasps" else next((tmp_path / "out" / "output").iterdir()) / "graspdata"
    assert not run_on(copy, folder).failures
    run_stage(copy, "simulate-touch", manifest(1, 0))
    ours, theirs = (ObjectRows(place, (*ALL_ARRAYS, *TOUCHES), split=None) for place in (data, copy))
    for name in (*ALL_ARRAYS, *TOUCHES):
        np.testing.assert_allclose(theirs.read(name, NAME), ours.read(name, NAME), rtol=0, atol=1e-9, err_msg=name)
    assert ours.read("force", NAME).max() > 0


@pytest.fixture
def arrays(data: Path) -> dict[str, Any]:
    """Return the grasps of the bottle as `export --to grasps` writes them, in metres, which its file has."""
    rows = ObjectRows(data, ["hand_pose", "joint_angles", "placement"], split=None)
    poses, placement = rows.read("hand_pose", NAME), rows.read("placement", NAME)
    scale = float(np.cbrt(np.linalg.det(placement[:3, :3])))
    in_file = np.linalg.inv(placement) @ poses
    in_file[:, :3, :3] *= scale
    names = load_hand("allegro_right").joint_names
    return {
        "hand_pose": in_file,
        "joint_angles": rows.read("joint_angles", NAME).copy(),
        "joint_names": np.array(names),
        "metres_per_unit": np.array(scale),
    }


def row_of(data: Path, *names: str) -> list[np.ndarray]:
    rows = ObjectRows(data, names, split=None)
    return [rows.read(name, NAME) for name in names]


def test_minimal_file_gives_the_same_touches_in_any_order_of_joints(arrays, data, copy, tmp_path):
    order = np.arange(16)[::-1]
    changed = {"joint_angles": arrays["joint_angles"][:, order], "joint_names": arrays["joint_names"][order]}
    (tmp_path / "in").mkdir()
    np.savez(tmp_path / "in" / f"{NAME}.npz", **(arrays | changed))
    run_on(copy, tmp_path / "in")
    for ours, theirs in zip(row_of(data, "joint_angles", "sensor_pose"), row_of(copy, "joint_angles", "sensor_pose"), strict=True):
        np.testing.assert_allclose(theirs, ours, atol=1e-12)


def test_names_and_root_of_another_model_are_translated(arrays, data, copy, tmp_path):
    root = np.eye(4)
    root[:3, :3], root[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], (0.01, 0, 0.034)
    scale = float(arrays["metres_per_unit"])
    inverse = np.linalg.inv(root)
    inverse[:3, 3] /= scale
    changed = {"hand_pose": arrays["hand_pose"] @ inverse, "joint_names": np.array([f"rh_{name}" for name in arrays["joint_names"]])}
    (tmp_path / "in").mkdir()
    np.savez(tmp_path / "in" / f"{NAME}.npz", **(arrays | changed))
    names = ", ".join(f"rh_{name}: {name}" for name in arrays["joint_names"])
    turn = "[0.01, 0, 0.034, 1, 0, 0, 1]"  # of any length
    run_on(copy, tmp_path / "in", f"read-grasps.joints={{{names}}}", f"read-grasps.root={turn}")
    np.testing.assert_allclose(*(row_of(place, "sensor_pose")[0] for place in (copy, data)), atol=1e-12)


def test_wrong_grasps_are_named_and_the_others_are_read(arrays, copy, tmp_path):
    wrong = {
        "0-scale": {"metres_per_unit": arrays["metres_per_unit"] / 2},
        "1-joint": {"joint_names": np.array(["wrist", *arrays["joint_names"][1:]])},
        "2-limits": {"joint_angles": arrays["joint_angles"] + 5},
        "3-inside": {"hand_pose": arrays["hand_pose"] * 0 + np.eye(4)},
        "4-fewer": {"joint_angles": arrays["joint_angles"][:, 1:], "joint_names": arrays["joint_names"][1:]},
        "5-far": {"hand_pose": arrays["hand_pose"] + np.array([[0, 0, 0, 1e30]] * 3 + [[0] * 4])},
        "6-target": {"squeeze": arrays["joint_angles"] * 1e30},
        "6-twice": {
            "joint_angles": arrays["joint_angles"][:, [*range(16), 0]],
            "joint_names": arrays["joint_names"][[*range(16), 0]],
        },
        "7-sound": {},
    }
    folder = tmp_path / "in" / NAME
    folder.mkdir(parents=True)
    for name, changes in wrong.items():
        np.savez(folder / f"{name}.npz", **({key: value[:1] if value.ndim > 1 else value for key, value in (arrays | changes).items()}))
    made = run_on(copy, tmp_path / "in")
    read, refused, touched, pose = row_of(copy, "grasp_files", "refused_grasps", "touch_success", "hand_pose")
    assert str(read) == f"{NAME}/7-sound.npz"
    reasons = str(refused).splitlines()
    expected = (
        "metres_per_unit: ",
        "'wrist'",
        "its limits are",
        "inside",
        "no value for",
        "positions are in m, in .npz in the mesh's unit",
        "in the squeeze",
        "is there twice",
    )
    for name, line, words in zip([*wrong][:8], reasons, expected, strict=True):
        assert line.startswith(f"{NAME}/{name}.npz: "), line
        assert words in line, line
    assert len(reasons) == 8
    assert touched[0].any()
    np.testing.assert_array_equal(touched[1], touched[0], err_msg="the only one is repeated")
    np.testing.assert_array_equal(pose[1], pose[0])
    assert "1 grasp of 1 object read, 8 refused" in made.notes
    assert GraspDataset(copy, ["hand_pose"]).items == [(NAME, 0)]
    run_stage(copy, "simulate-touch", manifest(1, 0))
    ((_, frames),) = (tables := GraspFrames(copy)).episodes()
    assert (tables.summary, [frame["grasp"] for frame in frames]) == ("1 grasp", [0])
    (touches,) = read_touches(copy).objects
    assert len(touches.touched) == len(touches.contacts) == 1
    assert len(touches.gels) == touches.touched.sum()
    vt("export", copy, tmp_path / "out", "--to", "grasps")
    with np.load(tmp_path / "out" / f"{NAME}.npz") as exported:
        assert len(exported["hand_pose"]) == 1


def test_recipe_of_grasps_from_files_is_refused_in_words(arrays, copy, tmp_path):
    (tmp_path / "in").mkdir()
    np.savez(tmp_path / "in" / f"{NAME}.npz", **arrays)
    run_on(copy, tmp_path / "in")
    with pytest.raises(InvalidInput, match="read-grasps read files that no recipe names"):
        recipe_of(copy, "one-of-each")


def test_more_grasps_than_the_setting_are_counted(arrays, copy, tmp_path):
    (tmp_path / "in").mkdir()
    three = {name: values[[0, 1, 1]] if values.ndim > 1 else values for name, values in arrays.items()}
    np.savez(tmp_path / "in" / f"{NAME}.npz", **three)
    made = run_on(copy, tmp_path / "in", "read-grasps.grasps=1")
    assert "1 grasp of 1 object read, 0 refused, 2 further not read: read-grasps.grasps is 1" in made.notes


def test_grasps_that_are_far_from_the_object_are_a_warning(arrays, copy, tmp_path):
    (tmp_path / "in").mkdir()
    poses = arrays["hand_pose"].copy()
    poses[:, 0, 3] += 1 / arrays["metres_per_unit"]
    np.savez(tmp_path / "in" / f"{NAME}.npz", **(arrays | {"hand_pose": poses}))
    (note,) = (note for note in run_on(copy, tmp_path / "in").notes if note.startswith("warning"))
    assert "2 of 2 grasps touch with no sensor: are poses in the frame and unit" in note


def test_object_without_usable_grasps_fails_with_the_reason(arrays, copy, tmp_path):
    (tmp_path / "in").mkdir()
    np.savez(tmp_path / "in" / f"{NAME}.npz", **(arrays | {"metres_per_unit": arrays["metres_per_unit"] * 2}))
    made = run_on(copy, tmp_path / "in")
    assert made.text.startswith("made 0 objects")
    (failure,) = made.failures.values()
    assert "none of its 2 grasps is usable; bottle-0000.npz, grasp 0: it is of an object of" in failure.reason


def test_grasps_without_object_and_objects_without_grasps_are_named(copy, tmp_path):
    (tmp_path / "in" / "zebra").mkdir(parents=True)
    settings = resolve("read-grasps", "draft", [f"read-grasps.folder={tmp_path / 'in'}"])
    first, second = load_stage("read-grasps").describe_objects(settings, manifest(1, 0).objects())
    assert "1 object without grasps" in first
    assert "whose object is not in the manifest (zebra)" in second
    (failure,) = run_on(copy, tmp_path / "in").failures.values()
    assert "call its file bottle-0000.npz" in failure.reason


def test_folder_must_be_named_and_exist(tmp_path):
    for assignments in ([], [f"read-grasps.folder={tmp_path}/none"]):
        with pytest.raises(InvalidInput, match="folder is"):
            list(load_stage("read-grasps").describe_objects(resolve("read-grasps", "draft", assignments), []))


def test_other_content_is_read_again_and_another_path_is_not(arrays, copy, tmp_path):
    (tmp_path / "in").mkdir()
    np.savez(tmp_path / "in" / f"{NAME}.npz", **arrays)
    assert run_on(copy, tmp_path / "in").objects == 1
    (tmp_path / "in").rename(tmp_path / "moved")
    assert not run_on(copy, tmp_path / "moved").objects
    np.savez(tmp_path / "moved" / f"{NAME}.npz", **(arrays | {"joint_angles": arrays["joint_angles"] + 0.01}))
    assert run_on(copy, tmp_path / "moved").objects == 1


def test_closed_and_tested_grasps_press_deeper(arrays, data, copy, tmp_path):
    (tmp_path / "in").mkdir()
    np.savez(tmp_path / "in" / f"{NAME}.npz", **arrays)
    run_on(copy, tmp_path / "in", "read-grasps.close=true", "read-grasps.hold_test=lift")
    (before,), (after, held) = row_of(data, "joint_angles"), row_of(copy, "joint_angles", "held")
    assert np.abs(after - before).max() > 1e-3
    assert held.shape == (GRASPS,)


def bench_file(arrays: dict[str, Any], path: Path, order: Sequence[int]) -> None:
    """Write the first grasp as DexGraspBench does, its joints in another order and without names."""
    scale, pose = float(arrays["metres_per_unit"]), arrays["hand_pose"][0]
    root = [*(scale * pose[:3, 3]), *Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True)]
    qpos = np.array([*root, *arrays["joint_angles"][0][list(order)]])
    path.parent.mkdir(parents=True)
    np.save(path, np.array({"obj_scale": scale, "obj_pose": np.eye(7)[3], "grasp_qpos": qpos}, object), allow_pickle=True)


def test_joints_without_names_are_those_of_the_model_or_of_the_setting(arrays, data, copy, tmp_path):
    hand = load_hand("allegro_right")
    names, order = list(hand.joint_names), [*range(8, 16), *range(8)]
    model = [joint.name for joint in hand.joints if joint.kind != "fixed"]
    bench_file(arrays, tmp_path / "model" / NAME / "0.npy", [names.index(name) for name in model])
    bench_file(arrays, tmp_path / "listed" / NAME / "0.npy", order)
    for folder, assignments in (("model", []), ("listed", [f"read-grasps.joints=[{', '.join(names[joint] for joint in order)}]"])):
        run_on(copy, tmp_path / folder, *assignments)
        (ours,), (theirs,) = row_of(data, "sensor_pose"), row_of(copy, "sensor_pose")
        np.testing.assert_allclose(theirs[0], ours[0], atol=1e-9)
    settings = resolve("read-grasps", "draft", [f"read-grasps.folder={tmp_path / 'model'}"])
    notes = list(load_stage("read-grasps").describe_misfits(settings, [(NAME, {})]))
    assert f"files do not name joints: read as {', '.join(model)} (read-grasps.joints)" in notes
    run = run_on(copy, tmp_path / "model", "read-grasps.joints=[a, b]")
    assert "names none of them, 2 joints of hand allegro_right are expected" in next(iter(run.failures.values())).reason
