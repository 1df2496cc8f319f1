"""The error of `sample-surfaces` in a trade, against the closed form for random points."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from pipeline.cli import app
from stages.sample_surfaces import coverage

RADIUS, POINTS = 0.25, 2000


def test_distance_to_the_nearest_point_is_that_of_independent_points(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.icosphere(5, RADIUS).export(tmp_path / "meshes" / "ball.ply")
    for name, points in (("data", POINTS), ("reference", 4 * POINTS)):
        options = [
            "--manifest",
            "directory",
            "--objects",
            tmp_path / "meshes",
            "--units",
            "m",
            "--data",
            tmp_path / name,
            "--executor",
            "serial",
        ]
        done = CliRunner().invoke(app, [*map(str, ["run", "sample-surfaces", *options, "--set", f"sample-surfaces.points={points}"])])
        assert done.exit_code == 0, done.output
    area = 4 * np.pi * RADIUS**2
    (error,) = coverage(tmp_path / "data", tmp_path / "reference").values()
    assert error == pytest.approx(1e3 * np.sqrt(area / (np.pi * POINTS)), rel=0.05)  # the reference's own first points give 10 % less
