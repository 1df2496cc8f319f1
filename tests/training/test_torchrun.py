"""Trainings of several processes as commands: the first process makes the model, the others help, and none is left when one is killed."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from tests.stages.tiny_dataset import manifest, run_stage

OBJECTS = manifest(2, 1)
TORCHRUN = (sys.executable, "-m", "torch.distributed.run")
SETTINGS = {"configuration": "none", "gcn_layers": 3, "gcn_features": 12, "loss_points": 200, "batch_size": 3, "threads": 1}
SETTINGS |= {"precision": "64-true", "accelerator": "cpu", "checkpoint_seconds": 0, "epochs": 3}


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Surface points of three bottles, and their manifest beside them."""
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(OBJECTS.model_dump(mode="json")))
    run_stage(tmp_path / "data", "sample-surfaces", OBJECTS)
    return tmp_path / "data"


def command(data: Path, **settings: object) -> list[str]:
    assignments = [f"--set=train-gcn.{name}={value}" for name, value in (SETTINGS | settings).items()]
    return ["-m", "pipeline", "run", "train-gcn", f"--data={data}", f"--manifest={data.parent / 'tiny.yaml'}", *assignments]


def start(*words: str) -> subprocess.Popen[str]:
    return subprocess.Popen([*TORCHRUN, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def finish(*started: subprocess.Popen[str], status: int = 0) -> str:
    """Wait for agents; what they and their processes printed."""
    output = "".join(process.communicate(timeout=120)[0] for process in started)
    assert [process.returncode for process in started] == [status] * len(started), output
    return output


def losses(data: Path) -> list[float]:
    folder = data / "models" / "gcn" / json.loads((data / "models" / "gcn" / "none.json").read_bytes())["location"]
    return [value for row in json.loads((folder / "metrics.json").read_bytes()) for value in row.values()]


def weights(data: Path) -> str:
    return str(json.loads((data / "models" / "gcn" / "none.json").read_bytes())["files"]["model.safetensors"])


def train_alone(data: Path) -> list[float]:
    subprocess.run([sys.executable, *command(data)], check=True, stdout=subprocess.DEVNULL)
    return losses(data)


def wait_for_checkpoint(data: Path, job: subprocess.Popen[str]) -> None:
    while not list(data.glob(".work/models/gcn/none/*/.checkpoint.safetensors")):
        assert job.poll() is None
        time.sleep(0.05)


def ranks(data: Path) -> dict[str, int]:
    """Find the processes of a training, by rank."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if str(data).encode() in (process / "cmdline").read_bytes():
                values = dict(line.split("=", 1) for line in (process / "environ").read_text().split("\0") if "=" in line)
                found[values.get("RANK", f"agent {process.name}")] = int(process.name)
        except OSError:  # it has ended
            continue
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_processes_end_with_the_command_that_started_them(data: Path, number: int, status: int) -> None:
    ignoring = ["sh", "-c", 'trap "" INT; exec "$@"', "sh"]  # as a job in the background
    job = subprocess.Popen([*ignoring, sys.executable, *command(data, devices=2, epochs=100_000)], stderr=subprocess.DEVNULL, text=True)
    wait_for_checkpoint(data, job)
    started = [int(child) for child in Path(f"/proc/{job.pid}/task/{job.pid}/children").read_text().split()]
    assert len(started) >= 2
    job.send_signal(number)
    began = time.monotonic()
    assert job.wait(60) == status
    while any(Path(f"/proc/{child}").exists() for child in started):
        assert time.monotonic() - began < 60
        time.sleep(0.1)


@pytest.mark.slow
def test_two_torchrun_processes_make_one_model_with_the_losses_of_one_process(data: Path) -> None:
    output = finish(start("--nproc-per-node=2", *command(data, devices=2)))
    assert output.count("made from 3 objects") == 1
    together = losses(data)
    assert together == pytest.approx(train_alone(data), rel=1e-6)


@pytest.mark.slow
def test_two_nodes_have_the_losses_of_one_process_and_then_are_up_to_date(data: Path) -> None:
    def agents() -> str:
        with socket.socket() as free:
            free.bind(("localhost", 0))
            where = f"--rdzv-endpoint=localhost:{free.getsockname()[1]}"
        meeting = ("--nnodes=2", "--nproc-per-node=1", "--rdzv-backend=c10d", where, "--rdzv-id=test")
        return finish(*(start(*meeting, *command(data, num_nodes=2)) for _ in range(2)))

    assert agents().count("made from 3 objects") == 1
    together = losses(data)
    assert agents().count("up to date") == 1
    assert together == pytest.approx(train_alone(data), rel=1e-6)


@pytest.mark.slow
def test_process_count_that_differs_from_the_settings_is_refused(data: Path) -> None:
    output = finish(start("--nproc-per-node=2", *command(data, devices=3)), status=1)
    assert "torchrun started 2 processes, 2 on this node, and the settings ask for 3 (devices 3 x num_nodes 1)" in output


@pytest.mark.slow
def test_killed_process_ends_the_job_which_resumes_to_the_same_weights(data: Path) -> None:
    finish(start("--nproc-per-node=2", *command(data, devices=2, epochs=40)))
    whole = weights(data)
    (data / "models" / "gcn" / "none.json").unlink()

    job = start("--nproc-per-node=2", *command(data, devices=2, epochs=40))
    wait_for_checkpoint(data, job)
    os.kill(ranks(data)["1"], signal.SIGKILL)
    began = time.monotonic()
    output = finish(job, status=1)
    assert time.monotonic() - began < 60
    assert "Signal 9 (SIGKILL) received" in output
    assert "what is finished is kept, run the same command to continue" in output
    assert ranks(data) == {}

    finish(start("--nproc-per-node=2", *command(data, devices=2, epochs=40)))
    assert weights(data) == whole
