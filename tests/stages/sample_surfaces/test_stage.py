"""A folder of bad meshes beside good ones: each with a reason, or used, the good ones as if alone; and the error of a trade."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.store.directory import Collection, DataDirectory
from schemas.surfaces import SURFACES
from stages.registry import resolve
from stages.sample_surfaces import coverage
from tests.command_line import vt

SPHERE = trimesh.creation.icosphere(subdivisions=2)


def write(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    path.parent.mkdir(exist_ok=True)
    with path.open("w") as file:
        file.writelines(f"v {x:.17g} {y:.17g} {z:.17g}\n" for x, y, z in np.asarray(vertices, float))
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in np.asarray(faces) + 1)


def grid(faces: int) -> tuple[np.ndarray, np.ndarray]:
    """Make a bumpy square of about this number of faces."""
    side = int(np.sqrt(faces / 2)) + 2
    x, y = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1, 1)
    cells = np.concatenate([first + [0, 1, side + 1], first + [0, side + 1, side]])
    return np.stack([x, y, 0.05 * np.sin(20 * x)], axis=-1).reshape(-1, 3), cells


def good(folder: Path) -> None:
    box, ring = trimesh.creation.box(), trimesh.creation.torus(1, 0.3)
    write(folder / "good" / "box.obj", box.vertices, box.faces)
    write(folder / "good" / "ring.obj", ring.vertices, ring.faces)


def usable(folder: Path) -> None:
    box = trimesh.creation.box()
    two = trimesh.util.concatenate([box, box.copy().apply_translation((0.5, 0.5, 0.5))])
    fan = [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    write(folder / "usable" / "triangle.obj", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    write(folder / "usable" / "open.obj", SPHERE.vertices, SPHERE.faces[SPHERE.triangles_center[:, 2] < 0.3])
    write(folder / "usable" / "inside-out.obj", SPHERE.vertices, SPHERE.faces[:, ::-1])
    write(folder / "usable" / "non-manifold.obj", [[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0]], fan)
    write(folder / "usable" / "self-intersecting.obj", two.vertices, two.faces)
    write(folder / "usable" / "tiny.obj", SPHERE.vertices * 1e-6, SPHERE.faces)
    write(folder / "usable" / "huge.obj", SPHERE.vertices * 1e6, SPHERE.faces)
    write(folder / "usable" / "far.obj", SPHERE.vertices + np.array([1e6, -1e6, 1e6]), SPHERE.faces)


def bad(folder: Path) -> None:
    (folder / "bad").mkdir()
    (folder / "bad" / "empty.obj").touch()
    (folder / "bad" / "text.obj").write_text("Dear reader,\nthis is a letter, not a mesh.\n")
    vertices = SPHERE.vertices.copy()
    vertices[3] = np.nan
    write(folder / "bad" / "nan.obj", vertices, SPHERE.faces)
    write(folder / "bad" / "faceless.obj", SPHERE.vertices, np.zeros((0, 3), int))
    write(folder / "bad" / "areafree.obj", [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    write(folder / "bad" / "many.obj", *grid(20_000))


REASONS = {
    "bad-empty": "is an empty file",
    "bad-text": "text.obj",
    "bad-nan": "1 of 162 vertices are NaN",
    "bad-faceless": "no triangle mesh",
    "bad-areafree": "zero area",
    "bad-many": "faces exceed max_faces = 10000; decimate the mesh or raise sample-surfaces.max_faces",
}


def surfaces(objects: Path, data: Path) -> Collection:
    arguments = ["run", "sample-surfaces", "--manifest", "directory", "--objects", str(objects), "--data", str(data)]
    vt(*arguments, "--set", "points=500", "--set", "max_faces=10000", "--executor", "serial")
    return DataDirectory(data).collection(SURFACES)


@pytest.fixture(scope="module")
def mixed(tmp_path_factory) -> tuple[Path, Collection]:
    folder = tmp_path_factory.mktemp("objects")
    for make in (good, usable, bad):
        make(folder)
    data = tmp_path_factory.mktemp("data")
    return data, surfaces(folder, data)


def test_each_bad_mesh_is_recorded_with_a_reason(mixed):
    _, found = mixed
    failures = {name: failure.reason for name in found if (failure := found.failure(name))}
    assert failures.keys() == REASONS.keys()
    for name, part in REASONS.items():
        assert part in failures[name]
    report = json.loads(vt("status", mixed[0], "--json"))["surfaces"]
    assert report["objects"] == 16
    assert report["failures"].keys() == REASONS.keys()


def test_each_usable_mesh_has_a_row(mixed):
    _, found = mixed
    for name in (name for name in found if not name.startswith("bad")):
        points = found.view(name)["points"]
        assert np.isfinite(points).all()
        assert np.linalg.norm(np.ptp(found.view(name)["meshes/vertices"], axis=0)) == pytest.approx(0.5)
    turned = found.view("usable-inside-out")
    assert (((turned["points"] - [0, 0, 0.6]) * turned["normals"]).sum(axis=1) > 0).all()


def test_good_meshes_are_unaffected_by_bad_ones(mixed, tmp_path):
    _, found = mixed
    (tmp_path / "objects").mkdir()
    good(tmp_path / "objects")
    alone = surfaces(tmp_path / "objects", tmp_path / "data")
    assert [name for name in alone] == ["good-box", "good-ring"]
    for name in alone:
        for array, value in alone.view(name).items():
            if array != "split":  # the split of an object depends on which others there are
                np.testing.assert_array_equal(value, found.view(name)[array], err_msg=array)


@pytest.mark.slow
def test_million_faces_need_a_higher_limit(tmp_path):
    write(tmp_path / "objects" / "million.obj", *grid(1_000_000))
    folders = ["--objects", tmp_path / "objects", "--data", tmp_path / "data"]
    arguments = ["run", "sample-surfaces", "--manifest", "directory", *folders]
    vt(*arguments)
    found = DataDirectory(tmp_path / "data").collection(SURFACES)
    failure = found.failure("million")
    assert failure is not None
    assert "exceed max_faces = 500000" in failure.reason
    vt(*arguments, "--set", "max_faces=2000000")
    assert DataDirectory(tmp_path / "data").collection(SURFACES).failure("million") is None


@pytest.mark.parametrize(
    ("assignment", "limit"),
    [
        ("sample-surfaces.points=1", "10 .it is 1"),  # has no extent, which later stages go by
        ("sample-surfaces.diagonal=1e-9", "0.001"),  # its float32 points would all be one
        ("sample-surfaces.diagonal=1e30", "100"),
        ("simulate-touch.sphere_tolerance=1e-17", "1e-9|1e-09|0.000000001"),  # rays would pass through faces
    ],
)
def test_settings_beyond_the_limits_of_rounding_are_refused(assignment, limit):
    with pytest.raises(InvalidInput, match=f"(greater|less) than or equal to ({limit})"):
        resolve(assignment.partition(".")[0], "standard", [assignment])


RADIUS, POINTS = 0.25, 2000


def test_distance_to_the_nearest_point_is_that_of_independent_points(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.icosphere(5, RADIUS).export(tmp_path / "meshes" / "ball.ply")
    for name, points in (("data", POINTS), ("reference", 4 * POINTS)):
        folders = ["--objects", tmp_path / "meshes", "--data", tmp_path / name]
        options = ["--manifest", "directory", "--units", "m", "--executor", "serial"]
        vt("run", "sample-surfaces", *folders, *options, "--set", f"sample-surfaces.points={points}")
    area = 4 * np.pi * RADIUS**2
    (error,) = coverage(tmp_path / "data", tmp_path / "reference").values()
    assert error == pytest.approx(1e3 * np.sqrt(area / (np.pi * POINTS)), rel=0.05)  # the reference's own first points give 10 % less
