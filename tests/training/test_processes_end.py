"""A training of several processes that is stopped leaves none of them."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from tests.stages.tiny_dataset import manifest, run_stage

OBJECTS = manifest(2, 1)
SETTINGS = {"configuration": "none", "gcn_layers": 3, "gcn_features": 12, "loss_points": 200, "batch_size": 3, "threads": 1}
SETTINGS |= {"precision": "64-true", "accelerator": "cpu", "checkpoint_seconds": 0, "epochs": 100_000, "devices": 2}


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Surface points of three bottles, and their manifest beside them."""
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(OBJECTS.model_dump(mode="json")))
    run_stage(tmp_path / "data", "sample-surfaces", OBJECTS)
    return tmp_path / "data"


def command(data: Path) -> list[str]:
    assignments = [f"--set=train-gcn.{name}={value}" for name, value in SETTINGS.items()]
    return ["-m", "pipeline", "run", "train-gcn", f"--data={data}", f"--manifest={data.parent / 'tiny.yaml'}", *assignments]


def wait_for_checkpoint(data: Path, job: subprocess.Popen[bytes]) -> None:
    while not list(data.glob(".work/models/gcn/none/*/.checkpoint.safetensors")):
        assert job.poll() is None
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_processes_end_with_the_command_that_started_them(data: Path, number: int, status: int) -> None:
    ignoring = ["sh", "-c", 'trap "" INT; exec "$@"', "sh"]  # as a job in the background
    job = subprocess.Popen([*ignoring, sys.executable, *command(data)], stderr=subprocess.DEVNULL)
    wait_for_checkpoint(data, job)
    started = [int(child) for child in Path(f"/proc/{job.pid}/task/{job.pid}/children").read_text().split()]
    assert len(started) >= 2
    job.send_signal(number)
    began = time.monotonic()
    assert job.wait(60) == status
    while any(Path(f"/proc/{child}").exists() for child in started):
        assert time.monotonic() - began < 60
        time.sleep(0.1)
