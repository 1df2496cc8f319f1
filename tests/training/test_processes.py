"""Trainings of several processes: the losses of one, a clear error when one is killed, and no process left running."""

import multiprocessing
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pytest
import torch
import yaml
from torch import nn
from torch.distributed import distributed_c10d

from pipeline.console import console_on
from pipeline.engine.stage import DatasetJob, DatasetStage
from pipeline.errors import StageError
from pipeline.training.checkpoint import read_metrics
from stages.train_gcn import TrainGcn
from stages.train_unet import TrainUnet
from tests.stages import ball_dataset
from tests.stages.tiny_dataset import manifest, run_stage
from tests.training.regression import Regression, fit

EXACT: dict[str, Any] = {"precision": "64-true", "threads": 1, "accelerator": "cpu"}
"""In float64 what Adam divides by is far above rounding: what is left between curves is a matter of what is computed."""


def assert_same_curves(one: Path, two: Path) -> None:
    curves = [read_metrics(folder) for folder in (one, two)]
    assert len(curves[0]) > 1
    for single, double in zip(*curves, strict=True):
        assert double == pytest.approx(single, rel=1e-6)


class Guarded(Regression):
    """In the processes that are started for it: whatever is unpickled from another process, or heard on the network, is an error."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        distributed_c10d._tensor_to_object = None  # type: ignore[assignment]

    def validate(self, network: nn.Module) -> dict[str, float]:
        heard = {one.laddr.ip for one in psutil.Process().net_connections("tcp") if one.status == psutil.CONN_LISTEN}
        if heard - {"127.0.0.1", "::1"}:
            raise StageError(f"listens on {heard}")
        return super().validate(network)


@pytest.mark.parametrize("devices", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_processes_have_the_losses_of_one_and_keep_to_themselves(tmp_path: Path, devices: int) -> None:
    """Parts of 48 items are uneven or, of three, empty; processes reject pickles and listen locally."""
    learners = [Regression(), Guarded()]
    for learner, count in zip(learners, (1, devices), strict=True):
        facts = fit(learner, tmp_path / str(count), devices=count, batch_size=46 if devices == 3 else 7, epochs=2, **EXACT)
        assert facts["hardware"]["processes"] == count
        assert facts["hardware"]["processor"]
    assert_same_curves(tmp_path / "1", tmp_path / str(devices))
    weights = [learner.network.state_dict() for learner in learners]
    assert weights[0].keys() == weights[1].keys()
    for name, value in weights[0].items():
        torch.testing.assert_close(weights[1][name], value, rtol=1e-5, atol=1e-6, check_dtype=False)


@pytest.fixture(scope="module")
def balls(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("balls")
    ball_dataset.make_data(data, 3, ("train", "train", "valid"))
    return data


UNET = {"width": 2, "epochs": 2, "batch_size": 7}
GCN = {"configuration": "occluded-touch", "gcn_layers": 3, "gcn_features": 12, "encoder_width": 0.125, "loss_points": 100}
GCN |= {"samples_per_object": 3, "validation_items": 2, "epochs": 2, "batch_size": 5}


@pytest.mark.slow
@pytest.mark.parametrize(("stage", "values"), [(TrainUnet(), UNET), (TrainGcn(), GCN)], ids=["unet", "gcn"])
def test_two_processes_have_the_losses_of_one_with_batch_norm(
    balls: Path, tmp_path: Path, stage: DatasetStage, values: dict[str, Any]
) -> None:
    for devices in (1, 2):
        folder = tmp_path / str(devices)
        folder.mkdir()
        settings = stage.settings_type.model_validate(values | EXACT | {"devices": devices})
        stage.make(DatasetJob(balls, folder, settings, 0, {}, console_on(sys.stdout), "models/trained"))
    assert_same_curves(tmp_path / "1", tmp_path / "2")


@pytest.mark.slow
def test_killed_process_ends_the_training_which_resumes_to_the_same_weights(tmp_path: Path) -> None:
    whole, resumed = Regression(), Regression()
    fit(whole, tmp_path / "whole", devices=2)
    with pytest.raises(StageError, match="regression: process 1 of 2 was ended by SIGKILL; run the same command again"):
        fit(Regression(kill_at=9), tmp_path / "killed", devices=2)
    assert not multiprocessing.active_children()
    fit(resumed, tmp_path / "killed", devices=2)
    for name, value in whole.network.state_dict().items():
        assert torch.equal(resumed.network.state_dict()[name], value)


def test_more_devices_than_gpus_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.training.loop.device_of", torch.device)
    monkeypatch.setattr("torch.cuda.device_count", lambda: 1)
    with pytest.raises(StageError, match="devices is 2, this machine has 1 GPU; lower it"):
        fit(Regression(), tmp_path, accelerator="cuda", devices=2)


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
