"""The tables of a big run: what they say of samples and records."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from benchmarks.big_run import processes_of, run_stage, size_of
from benchmarks.big_run_tables import seconds, tables
from pipeline.config.manifest import Manifest
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES
from tests.stages.tiny_dataset import run_stage as make

SAMPLES = [
    {
        "stage": "sample-surfaces",
        "seconds": second,
        "main": 2e8 + 1e7 * second,
        "workers": {"5": 3e8, "6": 5e8},
        "cpu": 1.5 * second,
        "open": 9,
    }
    for second in (10, 20, 30, 40)
] + [{"stage": "sample-surfaces", "seconds": 45, "main": 0, "workers": {}, "cpu": 0, "open": 0}]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Surfaces of one object, and of one that cannot be read."""
    root = tmp_path_factory.mktemp("big")
    (root / "meshes").mkdir()
    (root / "meshes" / "cube.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    (root / "meshes" / "none-7.obj").write_text("v 0 0 0\n")
    source = {"kind": "directory", "licence": "MIT", "up": "z", "path": root / "meshes"}
    objects = Manifest(name="m", description="d", seed=0, splits={"train": 1, "valid": 0, "test": 0}, sources=[source])
    with pytest.raises(AssertionError):  # one has failed
        make(root / "data", "sample-surfaces", objects)
    return root / "data"


def test_rates_memory_and_failures_are_those_of_samples_and_records(data):
    text = "\n".join(tables(data, SAMPLES, workers=2))
    slowest = max(seconds(DataDirectory(data).collection(SURFACES)).values())
    assert f"| sample-surfaces | 2 | 1 | 45 | 60 | {3600 * 2 / 90:.0f} | {3600 * 2 / 60:.0f} |" in text
    assert "| sample-surfaces | 4 | 400 → 600 | 400 → 400 | 1400 | 9 |" in text
    assert "| sample-surfaces | 1 | OBJECT.obj holds no triangle mesh" in text
    assert f"{slowest:.3g}"[:4] in text


def test_samples_are_of_the_process_and_the_folder(tmp_path):
    (tmp_path / "a").write_bytes(bytes(100))
    assert size_of(tmp_path) == {"bytes": 100, "files": 1}
    found = processes_of(os.getpid())
    assert found["main"] > 1e6
    assert found["cpu"] > 0


def test_a_stage_that_fails_ends_the_run(tmp_path):
    with pytest.raises(SystemExit, match="sample-surfaces ended with status 1"):
        run_stage("sample-surfaces", ["--manifest", "moon"], tmp_path, tmp_path / "log")
    assert '"status": 1' in (tmp_path / "log").read_text()
