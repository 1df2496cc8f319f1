"""Grasps for robots: in the frame and unit of the object's file, and in the format of DexGraspBench."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from pipeline.config.settings import Settings
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.plan import Request
from tests.command_line import vt
from tests.engine.tiny_stages import pack
from tests.stages import ball_dataset
from tests.stages.ball_dataset import CENTRE, SCALE, TURN


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    ball_dataset.make_data(folder, 1)
    return folder


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def exported(data: Path, out: Path, form: str) -> Path:
    vt("export", data, out, "--to", form)
    return out


def test_arrays_are_in_the_frame_and_unit_of_the_object_file(data: Path, tmp_path: Path) -> None:
    rows = ObjectRows(data, ["hand_pose", "touch_success", "points"], split=None)
    out = exported(data, tmp_path / "out", "grasps")
    assert {path.stem for path in out.iterdir()} == set(rows.object_ids)
    for name in rows.object_ids:
        with np.load(out / f"{name}.npz") as stored:
            poses, points, normals = stored["hand_pose"], stored["contact_points"], stored["contact_normals"]
            assert float(stored["metres_per_unit"]) == pytest.approx(SCALE)
            assert len(stored["joint_names"]) == stored["grasp"].shape[1] == stored["squeeze"].shape[1]
            assert "held" not in stored
        world = rows.read("hand_pose", name)
        np.testing.assert_allclose(SCALE * poses[:, :3, 3] @ TURN.T + CENTRE, world[:, :3, 3], atol=1e-9)
        np.testing.assert_allclose(TURN @ poses[:, :3, :3], world[:, :3, :3], atol=1e-9)
        touched = rows.read("touch_success", name)
        assert (np.isfinite(points).all(axis=2) == touched).all()
        radius = np.linalg.norm(rows.read("points", name) - CENTRE, axis=1).mean() / SCALE  # mm
        np.testing.assert_allclose(np.linalg.norm(points[touched], axis=1), radius, rtol=0.02)
        facing = (points[touched] * normals[touched]).sum(axis=1)
        np.testing.assert_allclose(facing, -radius, rtol=0.02)  # into the ball


@pytest.mark.parametrize("form", ["grasps", "mesh", "webdataset"])
def test_dataset_without_grasps_is_refused_and_writes_nothing(tmp_path: Path, form: str) -> None:
    ball_dataset.make_data(tmp_path / "my data", 1, ungrasped="a")
    printed = vt("export", tmp_path / "my data", tmp_path / "out", "--to", form, fails=True)
    assert f"vt-pipeline status '{tmp_path / 'my data'}'`" in printed
    assert not (tmp_path / "out").exists()


def test_unknown_object_is_named_with_the_existing_ones(data: Path, tmp_path: Path) -> None:
    assert vt("export", data, tmp_path / "b.glb", "--object", "zebra", fails=True).endswith("it has a")
    assert vt("export", data, tmp_path / "b.glb", "--object", "a").endswith("b.glb: 1 scene")


def test_dexgraspbench_files_keep_poses_and_mass(data: Path, tmp_path: Path) -> None:
    rows = ObjectRows(data, ["hand_pose", "joint_angles", "points"], split=None)
    out = exported(data, tmp_path / "out", "dexgraspbench")
    name = rows.object_ids[0]
    files = sorted((out / "output" / "vt-pipeline_allegro_right" / "graspdata" / name).glob("*/*.npy"))
    assert len(files) == rows.size("joint_angles", "grasp")
    for grasp, file in enumerate(files):
        content = np.load(file, allow_pickle=True).item()
        qpos, world = content["grasp_qpos"], rows.read("hand_pose", name, grasp)
        np.testing.assert_allclose(TURN @ qpos[:3] + CENTRE, world[:3, 3], atol=1e-9)
        np.testing.assert_allclose(TURN @ Rotation.from_quat(qpos[3:7], scalar_first=True).as_matrix(), world[:3, :3], atol=1e-9)
        np.testing.assert_array_equal(qpos[7:], rows.read("joint_angles", name, grasp))
        assert content["obj_scale"] == pytest.approx(SCALE)
    folder = out / content["obj_path"]
    about = json.loads((folder / "info" / "simplified.json").read_text())
    radius = np.linalg.norm(rows.read("points", name) - CENTRE, axis=1).mean() / SCALE
    parts = [trimesh.load(path) for path in (folder / "urdf" / "meshes").iterdir()]
    assert sum(part.volume for part in parts) == pytest.approx(about["mass"], rel=1e-6)
    assert about["mass"] == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.05)


def test_grasps_of_other_surfaces_are_refused(tmp_path: Path) -> None:
    ball_dataset.make_data(tmp_path / "data", 1)
    surfaces, *_ = ball_dataset.stages()
    asked: Any = Request(surfaces, Settings(), "balls", ball_dataset.objects(1), "draft", 2, tmp_path / "data")
    pack(asked, lambda unit: (row := surfaces.row(unit)) | {"points": row["points"][::-1]})
    assert "was made from other surfaces than the current ones" in vt(
        "export", tmp_path / "data", tmp_path / "out", "--to", "grasps", fails=True
    )
