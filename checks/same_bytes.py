"""The four stages of a dataset give the same bytes on every processor that this one can imitate."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from checks.processors import environment

OBJECTS = [
    {"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"knife": 1}},
    {"kind": "pybullet", "licence": "zlib", "up": "z", "files": {"duck": {"file": "duck.obj", "up": "y"}}},
]
SETTINGS = ("sample-surfaces.points=1000", "simulate-grasps.grasps=1", "simulate-grasps.ik_samples=256", "render-vision.resolution=64")
MAKE = """
import sys
from pipeline.cli import app
manifest, data, *settings = sys.argv[1:]
for stage in ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch"):
    assignments = [part for setting in settings for part in ("--set", setting)]
    app(["run", stage, "--manifest", manifest, "--data", data, "--executor", "serial", *assignments], standalone_mode=False)
print("status")
app(["status", data, "--json"], standalone_mode=False)
"""


def digests(folder: Path, **variables: str) -> dict[str, str]:
    """Make a small dataset in a process with these environment variables; return the digest of each artifact."""
    manifest = folder / "manifest.yaml"
    splits = {"train": 1.0, "valid": 0.0, "test": 0.0}
    manifest.write_text(yaml.safe_dump({"name": "small", "description": "d", "seed": 0, "splits": splits, "sources": OBJECTS}))
    command = [sys.executable, "-c", MAKE, str(manifest), str(folder / "data"), *SETTINGS]
    completed = subprocess.run(command, env={**os.environ, **variables}, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    report = json.loads(completed.stdout.partition("status\n")[2])
    assert len(report) == 4
    assert not any(artifact["failures"] for artifact in report.values()), report
    return {name: artifact["digest"] for name, artifact in report.items()}


@pytest.fixture(scope="module")
def reference_digests(tmp_path_factory) -> dict[str, str]:
    """Compute the digests with all of this processor's features."""
    return digests(tmp_path_factory.mktemp("here"))


@pytest.mark.parametrize("profile", ["haswell", "prescott"])
def test_digests_do_not_depend_on_the_processor(profile, reference_digests, tmp_path) -> None:
    variables = environment(profile)
    del variables["GLIBC_TUNABLES"]  # PyBullet takes sines from the C library: without FMA, joints rest up to 2e-15 rad elsewhere
    assert digests(tmp_path, **variables) == reference_digests
