"""Grasps for robots: in the frame and unit of the object's file, and in the format of DexGraspBench."""

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial.transform import Rotation

from pipeline.config.settings import Settings
from pipeline.contrib.exports import grasp_files
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.plan import Request
from pipeline.errors import InvalidInput
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES
from tests.command_line import vt
from tests.contrib.exports.test_exports import add_forces, elastic  # noqa: F401
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
    assert {path.name for path in out.iterdir()} == {f"{name}.{suffix}" for name in rows.object_ids for suffix in ("npz", "obj")}
    for name in rows.object_ids:
        with np.load(out / f"{name}.npz") as stored:
            poses, points, normals = stored["hand_pose"], stored["contact_points"], stored["contact_normals"]
            assert float(stored["metres_per_unit"]) == pytest.approx(SCALE)
            assert len(stored["joint_names"]) == stored["grasp"].shape[1] == stored["squeeze"].shape[1]
            assert not {"held", "force", "pressure"} & set(stored)
            assert stored["sensors"].tolist() == ["gel_16mm"] * 4
            mesh = trimesh.load(out / str(stored["object_file"]), process=False)
        world = rows.read("hand_pose", name)
        np.testing.assert_allclose(SCALE * poses[:, :3, 3] @ TURN.T + CENTRE, world[:, :3, 3], atol=1e-9)
        np.testing.assert_allclose(TURN @ poses[:, :3, :3], world[:, :3, :3], atol=1e-9)
        touched = rows.read("touch_success", name)
        assert (np.isfinite(points).all(axis=2) == touched).all()
        radius = np.linalg.norm(rows.read("points", name) - CENTRE, axis=1).mean() / SCALE  # mm
        np.testing.assert_allclose(np.linalg.norm(points[touched], axis=1), radius, rtol=0.02)
        np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), radius, rtol=0.02)
        np.testing.assert_allclose(
            SCALE * mesh.vertices @ TURN.T + CENTRE,
            read_mesh(DataDirectory(data).collection(SURFACES).view(name)).vertices,
            rtol=0,
            atol=1e-12,
        )
        facing = (points[touched] * normals[touched]).sum(axis=1)
        np.testing.assert_allclose(facing, -radius, rtol=0.02)  # into the ball


def test_arrays_have_forces_pressures_and_what_held_with_their_units(elastic: Path, tmp_path: Path) -> None:  # noqa: F811
    rows = ObjectRows(elastic, ["force", "pressure", "held", "sensor_pose"], split=None)
    out = exported(elastic, tmp_path / "out", "grasps")
    for name in rows.object_ids:
        with np.load(out / f"{name}.npz") as stored:
            for array in ("force", "pressure", "held"):
                np.testing.assert_array_equal(stored[array], rows.read(array, name))
            np.testing.assert_allclose(TURN @ stored["up"], [0, 0, 1], atol=1e-12)
            assert {"force: N", "pressure: Pa"} <= set(stored["units"].tolist())
            moved = SCALE * stored["sensor_pose"][..., :3, 3] @ TURN.T + CENTRE
            np.testing.assert_allclose(moved, rows.read("sensor_pose", name)[..., :3, 3], atol=1e-9)


def test_object_whose_touches_failed_keeps_its_grasps(tmp_path: Path) -> None:
    ball_dataset.make_data(tmp_path / "data", 2)
    stage = ball_dataset.stages()[3]
    asked: Any = Request(stage, Settings(), "balls", ball_dataset.objects(2), "draft", 1, tmp_path / "data")
    pack(asked, lambda unit: add_forces(unit, "touch", stage.row(unit)), failed="b")
    out = exported(tmp_path / "data", tmp_path / "out", "grasps")
    with np.load(out / "a.npz") as a, np.load(out / "b.npz") as b:
        assert set(a) - set(b) == {"force", "pressure"}
        assert a["grasp"].shape == b["grasp"].shape


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


def test_dexgraspbench_has_the_hand_whose_joints_are_in_the_order_of_qpos(data: Path, tmp_path: Path) -> None:
    out = exported(data, tmp_path / "out", "dexgraspbench")
    described = yaml.safe_load((out / "config" / "hand" / "allegro_right.yaml").read_text())
    model = mujoco.MjModel.from_xml_path(str(out / described["xml_path"]))
    names = [model.joint(number).name for number in range(model.njnt)]
    bodies = {model.body(number).name for number in range(model.nbody)}
    assert {*described["valid_body_name"], *described["tip_body_name"], *described["finger_prefix"]} <= bodies
    for file in out.rglob("*.npy"):
        assert np.load(file, allow_pickle=True).item()["joint_names"].tolist() == names


def test_each_object_is_written_when_it_is_done_and_a_failed_export_continues(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ball_dataset.make_data(tmp_path / "data", 2)
    written = grasp_files._write_object

    def fails(grasped: Any, folder: Path) -> None:
        if grasped.name == "b":
            raise InvalidInput("no parts")
        written(grasped, folder)

    monkeypatch.setattr(grasp_files, "_write_object", fails)
    out = tmp_path / "out"
    assert "no parts" in vt("export", tmp_path / "data", out, "--to", "dexgraspbench", fails=True)
    assert {path.name for path in (out / "assets" / "vt-pipeline").iterdir()} == {"a"}
    assert len([*out.rglob("*.npy")]) == 5
    monkeypatch.undo()
    assert "an earlier export was stopped there" in vt("export", tmp_path / "data", out, "--to", "dexgraspbench")
    assert {path.name for path in out.iterdir()} == {"assets", "config", "output"}
    assert {path.name for path in (out / "assets" / "vt-pipeline").iterdir()} == {"a", "b"}
    assert "is not empty" in vt("export", tmp_path / "data", out, "--to", "dexgraspbench", fails=True)
    vt("export", tmp_path / "data", tmp_path / "b", "--to", "dexgraspbench", "--object", "b")
    assert {path.name for path in (tmp_path / "b" / "assets" / "vt-pipeline").iterdir()} == {"b"}


@pytest.mark.parametrize("form", ["grasps", "dexgraspbench"])
def test_unknown_object_is_refused_by_exports_for_robots(data: Path, tmp_path: Path, form: str) -> None:
    assert vt("export", data, tmp_path / "out", "--to", form, "--object", "zebra", fails=True).endswith("it has a")


def test_grasps_of_other_surfaces_are_refused(tmp_path: Path) -> None:
    ball_dataset.make_data(tmp_path / "data", 1)
    surfaces, *_ = ball_dataset.stages()
    asked: Any = Request(surfaces, Settings(), "balls", ball_dataset.objects(1), "draft", 2, tmp_path / "data")
    pack(asked, lambda unit: (row := surfaces.row(unit)) | {"points": row["points"][::-1]})
    assert "was made from other surfaces than the current ones" in vt(
        "export", tmp_path / "data", tmp_path / "out", "--to", "grasps", fails=True
    )
