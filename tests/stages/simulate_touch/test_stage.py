"""The stage on a pressed ball: arrays as declared, and one from another as documented."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import trimesh

from pipeline.dataset.mesh_rows import mesh_row
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Unit
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.touch.depth_maps import local_points, touch_success
from pipeline.kernels.touch.tactile_image import tactile_image
from pipeline.store.rows import Row
from stages.simulate_touch import SimulateTouch, TouchSettings
from tests.kernels.touch.shapes import SENSOR, pose_at
from tests.stages.lifted_objects import coarse_gel

STAGE = SimulateTouch()
SIZES = {"row": 100, "col": 100, "rgb": 3, "point": 10_000, "xyz": 3, "grasp": 2, "sensor": 3}
WORN = ("gel_16mm",) * 3
CENTRE = np.array([0.0, 0.0, 0.6])


def inputs(poses: np.ndarray) -> dict[str, Any]:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    mesh = Mesh.bare(np.asarray(ball.vertices) + CENTRE, np.asarray(ball.faces))
    return {"surfaces": mesh_row(mesh) | {"points": mesh.vertices}, "grasps": {"sensor_pose": poses}}


def six_poses() -> np.ndarray:
    """(2, 3, 4, 4): at 1 to 6 mm, 12 mm (sees, does not touch) and 1 m from the ball."""
    distances = [0.001, 0.003, 0.006, 0.0065, 0.012, 1.0]
    axes = np.random.default_rng(0).normal(size=(6, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    poses = [pose_at(CENTRE + 0.05 * a, -a, d) for a, d in zip(axes, distances, strict=True)]
    return np.stack(poses).reshape(2, 3, 4, 4)


def run(settings: TouchSettings, poses: np.ndarray) -> Row:
    with STAGE.session(settings, {}) as process:
        return process(Unit("ball"), inputs(poses))


@pytest.mark.parametrize("tracer", ["ray", "sphere"])
def test_rows_match_the_schema_and_follow_from_depth(tracer: Literal["ray", "sphere"]) -> None:
    settings = TouchSettings(sensors=WORN, tracer=tracer, store_points=True)
    poses = six_poses()
    row = run(settings, poses)
    for name, array in {**row, **STAGE.constants(settings)}.items():
        declared = STAGE.output.arrays[name]
        assert array.shape == tuple(SIZES[d] for d in declared.dims if d != "object"), name
        assert array.dtype == declared.dtype, name
    assert touch_success(row["depth"], SENSOR).tolist() == [[True, True, True], [True, False, False]]
    assert np.isfinite(row["depth"][1, 1]).any()  # seen, though not touched
    assert np.isinf(row["depth"][1, 2]).all()
    assert (row["tactile_image"][1, 1:] == STAGE.constants(settings)["untouched"][1:]).all()
    for index in np.ndindex(2, 3):
        assert (row["tactile_image"][index] == tactile_image(row["depth"][index], SENSOR)).all()
        points, count = local_points(row["depth"][index], poses[index], SENSOR)
        assert row["local_points"][index].tobytes() == points.tobytes()
        assert row["local_count"][index] == count
        radii = np.linalg.norm(points[:count] - CENTRE, axis=1)
        assert (np.abs(radii - 0.05) < 2e-4).all()


def test_tracers_agree_to_the_tolerance() -> None:
    ray = run(TouchSettings(sensors=WORN, tracer="ray", gel_bits=None, far_bits=None), six_poses())["depth"]
    sphere = run(TouchSettings(sensors=WORN, tracer="sphere", gel_bits=None, far_bits=None), six_poses())["depth"]
    assert (np.isfinite(ray) == np.isfinite(sphere)).all()
    assert np.abs(ray[np.isfinite(ray)] - sphere[np.isfinite(ray)]).max() <= 2e-7


def test_local_points_are_stored_on_request() -> None:
    settings = TouchSettings(sensors=WORN)
    assert set(run(settings, six_poses())) == {"depth", "tactile_image"}
    assert STAGE.attributes(settings)["sensors"][0]["w"] == SENSOR.w
    assert [path.name for path in STAGE.assets(settings)] == ["gel_16mm.yaml"]


def test_pose_that_is_not_finite_is_invalid_input() -> None:
    poses = six_poses()
    poses[1, 2, 0, 0] = np.nan
    with pytest.raises(InvalidInput, match="not finite"):
        run(TouchSettings(sensors=WORN), poses)


def test_sensors_follow_the_grasps_and_may_differ_between_fingers(tmp_path: Path) -> None:
    """A thinner gel on the last finger: its tactile images, its untouched image and its local points are its own."""
    thin = tmp_path / "thin.yaml"
    thin.write_text(description_path("sensor", "gel_16mm").read_text().replace("w: 0.0068", "w: 0.002"))
    worn = ("gel_16mm", "gel_16mm", str(thin))
    settings = STAGE.resolve_settings(TouchSettings(store_points=True), {"grasps": {"hand": {"sensor_files": list(worn)}}})
    assert settings.sensors == worn
    row, alike = run(settings, six_poses()), run(TouchSettings(sensors=WORN, store_points=True), six_poses())
    assert (row["tactile_image"][:, :2] == alike["tactile_image"][:, :2]).all()
    assert (row["tactile_image"][0, 2] == STAGE.constants(settings)["untouched"][2]).all()  # 6 mm away: in the thick gel alone
    assert row["local_count"][0].tolist()[2] == 0 < alike["local_count"][0, 2]
    assert [one["w"] for one in STAGE.attributes(settings)["sensors"]] == [0.0068, 0.0068, 0.002]
    assert [path.name for path in STAGE.assets(settings)] == ["gel_16mm.yaml", "thin.yaml"]


def elastic(folder: Path, modulus: float) -> str:
    path = folder / f"soft_{modulus:g}.yaml"
    path.write_text(description_path("sensor", "gel_16mm").read_text() + f"gel: {{modulus: {modulus}}}\n")
    return str(path)


def test_elastic_gel_stores_pressure_and_force(tmp_path: Path) -> None:
    soft = elastic(tmp_path, 1e5)
    settings = TouchSettings(sensors=(soft, soft, elastic(tmp_path, 2e5)))
    row, rigid = run(settings, six_poses()), run(TouchSettings(sensors=WORN), six_poses())
    assert (row["depth"] == rigid["depth"]).all()
    for name in ("pressure", "force"):
        assert row[name].dtype == STAGE.output.arrays[name].dtype
    pixel = np.prod(SENSOR.pitch)
    np.testing.assert_allclose(row["force"], row["pressure"].sum(axis=(-2, -1)) * pixel, rtol=1e-5)
    np.testing.assert_allclose(row["indentation"], np.maximum(SENSOR.w - row["depth"].min(axis=(-2, -1)), 0), atol=1e-9)
    assert row["force"][0, 0] > row["force"][0, 1] > 0  # 1 mm and 3 mm from a ball under 6.8 mm of gel
    assert (row["force"][1] > 0).tolist() == [True, False, False]
    touched = row["pressure"] > 0
    assert 0 < touched[0, 2].sum() < (row["depth"][0, 2] < SENSOR.w).sum()  # 6 mm away: the gel gives way around the contact
    assert (row["tactile_image"][0, 0] != rigid["tactile_image"][0, 0]).any()
    alike = run(TouchSettings(sensors=(elastic(tmp_path, 2e5),) * 3), six_poses())
    np.testing.assert_allclose(alike["force"][0, 0], 2 * row["force"][0, 0], rtol=1e-5)
    assert (alike["tactile_image"] == row["tactile_image"]).all()  # how stiff it is changes no shape


def test_lift_is_computed_on_request(tmp_path: Path) -> None:
    """Two gels at the ball's sides: the arrays are as declared, carry its weight in the end, and leave the others as they are."""
    worn = (str(coarse_gel(tmp_path, None)),) * 2
    poses = np.stack([pose_at(CENTRE + [0.05 * side, 0, 0], np.array([-side, 0, 0]), 0.005) for side in (1, -1)])[None]
    lift = TouchSettings(sensors=worn, sequence="lift", lift_steps=16, lift_mass=0.05, lift_friction=0.8, lift_store=None)
    row, still = run(lift, poses), run(TouchSettings(sensors=worn), poses)
    added = set(row) - set(still)
    assert all((row[name] == still[name]).all() for name in still)
    declared = {name: array for name, array in STAGE.output.arrays.items() if name.startswith("lift_")}
    assert added == set(declared) - {"lift_traction", "lift_marker_displacement"}
    sizes = SIZES | {"row": 20, "col": 20, "grasp": 1, "sensor": 2, "step": 16, "xy": 2, "pose_row": 4, "pose_column": 4}
    for name in added:
        assert row[name].shape == tuple(sizes[d] for d in declared[name].dims if d != "object"), name
        assert row[name].dtype == declared[name].dtype, name
    assert (row["lift_depth"][0, :, 0] == row["depth"][0]).all()
    assert (row["lift_tactile_image"][0, :, 0] == row["tactile_image"][0]).all()
    np.testing.assert_allclose(-row["lift_force"][0, :, 0, 2], row["force"][0], rtol=1e-6)
    carried = -sum(pose[:3, :3] @ force for pose, force in zip(poses[0], row["lift_force"][0, :, -1], strict=True))
    np.testing.assert_allclose(carried, [0, 0, 0.05 * 9.81], atol=0.02 * 0.05 * 9.81)
    assert row["lift_held"].all()
    assert row["lift_settled"].all()


def test_lift_takes_mass_and_friction_from_the_grasps(tmp_path: Path) -> None:
    soft = str(coarse_gel(tmp_path, None))
    grasps = {"hand": {"sensor_files": [soft] * 4}, "settings": {"hold_mass": 0.3, "hand": "allegro_right", "squeeze": 0.002}}
    resolved = STAGE.resolve_settings(TouchSettings(sequence="lift"), {"grasps": grasps})
    assert (resolved.lift_mass, resolved.lift_friction, resolved.lift_squeeze) == (0.3, 0.5, 0.002)
    known = Path(soft).read_text().replace("gel: {", "gel: {friction: 0.9, ")
    (tmp_path / "known.yaml").write_text(known)
    worn = TouchSettings(sequence="lift", sensors=(str(tmp_path / "known.yaml"),) * 4, lift_mass=1.0)
    resolved = STAGE.resolve_settings(worn, {"grasps": grasps})
    assert (resolved.lift_mass, resolved.lift_friction) == (1.0, None)


def test_each_gel_of_a_lift_has_the_friction_of_its_file(tmp_path: Path) -> None:
    """Two gels at the ball's sides: the one that states its friction has it, and only the other takes the setting's."""
    rough, bare = coarse_gel(tmp_path, 0.9), coarse_gel(tmp_path.parent, None)
    poses = np.stack([pose_at(CENTRE + [0.05 * side, 0, 0], np.array([-side, 0, 0]), 0.005) for side in (1, -1)])[None]
    settings = TouchSettings(
        sensors=(str(rough), str(bare)),
        sequence="lift",
        lift_steps=8,
        lift_mass=20.0,
        lift_friction=0.2,
        lift_store=["pressure", "traction"],
    )
    row = run(settings, poses)
    first = row["lift_held"][0].nonzero()[0].max()  # the last step in which they hold: the ball slides down
    for finger, friction in enumerate((0.9, 0.2)):
        pressure, traction = (row[f"lift_{name}"][0, finger, 1 : first + 1] for name in ("pressure", "traction"))
        share = np.hypot(*np.moveaxis(traction, -1, 0))[pressure > 0] / pressure[pressure > 0]
        assert share.max() == pytest.approx(friction, rel=2e-3)
    stated = settings.model_copy(update={"sensors": (str(rough),) * 2})
    with pytest.raises(InvalidInput, match=r"lift_friction is 0.2, but the files of all sensors state theirs; leave it out"):
        STAGE.check_inputs(stated, {"grasps": {"hand": {"sensor_files": [str(rough)] * 2, "sensor_digest": "0"}}})


@pytest.mark.parametrize(
    ("worn", "store", "words"),
    [
        (WORN, None, "gel_16mm has no elastic gel"),
        (("gelsight",), ("marker_displacement",), "gelsight has none; add `markers"),
    ],
)
def test_lift_that_cannot_be_computed_is_refused(worn, store, words: str) -> None:
    settings = TouchSettings(sensors=worn, sequence="lift", lift_friction=0.5, lift_store=store)
    with pytest.raises(InvalidInput, match=words):
        STAGE.check_inputs(settings, {"grasps": {"hand": {"sensor_files": list(worn), "sensor_digest": "0"}}})


def test_sensors_other_than_those_of_the_hand_are_refused(tmp_path: Path) -> None:
    digest, none = assets_digest(STAGE.assets(TouchSettings(sensors=WORN))), "0" * 64
    moved = [f"/home/a/{name}.yaml" for name in WORN]  # the same content, elsewhere
    mixed = ("gel_16mm", "gel_16mm", elastic(tmp_path, 1e5))

    def check(worn: tuple[str, ...], files: list[str], recorded: str) -> None:
        STAGE.check_inputs(TouchSettings(sensors=worn), {"grasps": {"hand": {"sensor_files": files, "sensor_digest": recorded}}})

    check(WORN, list(WORN), digest)
    check(WORN, moved, digest)
    for worn, files, words in (
        (WORN, list(WORN), "the file of sensor gel_16mm has changed since the grasps were made"),
        (WORN, ["other"], r"the hand wears \['other'\], simulate-touch.sensors is .*gel_16mm"),
        (mixed, list(mixed), "soft_100000.yaml but not of gel_16mm"),
    ):
        with pytest.raises(InvalidInput, match=words):
            check(worn, files, none)
