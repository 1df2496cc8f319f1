"""`read-grasps`: grasps that this project exports come back the same, other files' grasps one by one."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipeline.console import errors
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.make import make
from pipeline.engine.plan import Made, Request
from stages.registry import load_stage, resolve
from tests.command_line import vt
from tests.stages.tiny_dataset import ASSIGNMENTS, manifest, run_stage

NAME, GRASPS = "bottle-0000", 2
ALL_ARRAYS = ("hand_pose", "joint_angles", "pregrasp_angles", "squeeze_angles", "sensor_pose", "contact_point", "contact_area", "closure")
TOUCHES = ("depth", "tactile_image", "pressure", "force")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Grasp a bottle twice, and simulate the touches."""
    folder = tmp_path_factory.mktemp("simulated")
    for name in ("sample-surfaces", "simulate-grasps", "simulate-touch"):
        run_stage(folder, name, manifest(1, 0), f"simulate-grasps.grasps={GRASPS}", "simulate-grasps.sensor=gelsight_mini")
    return folder


def read(data: Path, folder: Path, *assignments: str) -> tuple[Path, Made]:
    """Read grasps in place of those of a copy of a dataset."""
    copy = folder.parent / "copy"
    shutil.copytree(data, copy)
    settings = resolve("read-grasps", "draft", [*ASSIGNMENTS, "sensor=gelsight_mini", f"read-grasps.folder={folder}", *assignments])
    objects = manifest(1, 0)
    (made,) = make(Request(load_stage("read-grasps"), settings, objects.name, objects.objects(), "draft", 0, copy), errors)
    return copy, made


@pytest.mark.parametrize("form", ["grasps", "dexgraspbench"])
def test_exported_grasps_come_back_with_the_same_touches(form, data, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    vt("export", data, tmp_path / "out", "--to", form)
    folder = tmp_path / "out" if form == "grasps" else next((tmp_path / "out" / "output").iterdir()) / "graspdata"
    copy, _ = read(data, folder, f"grasps={GRASPS}")
    run_stage(copy, "simulate-touch", manifest(1, 0))
    ours, theirs = (ObjectRows(place, (*ALL_ARRAYS, *TOUCHES), split=None) for place in (data, copy))
    for name in (*ALL_ARRAYS, *TOUCHES):
        np.testing.assert_allclose(theirs.read(name, NAME), ours.read(name, NAME), rtol=0, atol=1e-9, err_msg=name)
    assert ours.read("force", NAME).max() > 0
