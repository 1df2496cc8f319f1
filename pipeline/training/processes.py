"""The processes of a training on this machine, by Lightning Fabric: start them, and end them with it."""

import logging
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

import torch.distributed
from lightning_fabric import Fabric
from lightning_fabric.loggers.tensorboard import TensorBoardLogger
from lightning_fabric.plugins.environments.lightning import LightningEnvironment
from lightning_fabric.plugins.precision.amp import MixedPrecision
from lightning_fabric.strategies.ddp import DDPStrategy
from lightning_fabric.utilities import rank_zero
from lightning_fabric.utilities.exceptions import MisconfigurationException

from pipeline.errors import StageError
from pipeline.store.digest import LOGS
from pipeline.store.temporary import temporary_folder
from pipeline.training.device import device_of
from pipeline.training.settings import TrainingSettings

RESUME_HINT = "run the same command again: it goes on from its last checkpoint"
"""The remedy in messages about a training that ended early."""

LOST = ("onnection closed", "onnection reset", "roken pipe", "imed out", "onnection refused")
"""Parts of gloo's messages of lost connections between processes, for which it has no error type."""

REPORT_DELAY = 3.0
"""Seconds by which the other processes delay their end after one was killed, so that their launcher reports the killed one."""

SILENCE = timedelta(minutes=10)
"""Longest wait for an answer of a running process: more than a checkpoint or the reading of a list of items takes.
A killed process is noticed immediately."""


class MixedPrecisionLayers(MixedPrecision):
    """Autocast a network's layers and keep its inputs: in bfloat16 a point of the scene is rounded by millimetres."""

    def convert_input(self, data: Any) -> Any:
        """Return the inputs."""
        return data


class LocalProcesses(DDPStrategy):
    """Processes that meet by a file in the folder of `end_children_on_interrupt`: torch's port would be open to the network."""

    def __init__(self) -> None:
        super().__init__(start_method="spawn", timeout=SILENCE)

    def setup_environment(self) -> None:
        """Join the other processes, before Fabric would by a port."""
        assert self.accelerator is not None
        self.accelerator.setup_device(self.root_device)
        gpu = self.root_device.type == "cuda"
        torch.distributed.init_process_group(
            "nccl" if gpu else "gloo",
            init_method=(Path(tempfile.gettempdir()) / "processes").as_uri(),
            rank=self.local_rank,
            world_size=self.num_processes,
            timeout=SILENCE,
            device_id=self.root_device if gpu else None,
        )
        super().setup_environment()


def make_fabric(
    settings: TrainingSettings,  # give accelerator, devices and precision
    folder: Path,  # of the model; TensorBoard logs go below it
) -> Fabric:
    """Make the `Fabric` that runs a training in the processes that the settings ask for, or raise a `StageError`."""
    logging.getLogger(rank_zero.__name__).setLevel(logging.WARNING)  # its advice names calls that no setting makes
    try:
        device = device_of(settings.accelerator).type
        precision: Any = settings.precision
        plugins: list[Any] = [LightningEnvironment()]  # in a job of Slurm, too
        if precision == "bf16-mixed":
            plugins.append(MixedPrecisionLayers(precision, device))
            precision = None  # Fabric takes it from the plugin
        strategy: Any = "auto"
        if settings.devices > 1:
            strategy = LocalProcesses()
            os.environ.setdefault("GLOO_SOCKET_IFNAME", "lo")  # no other machine has to reach them
        return Fabric(
            accelerator=device,
            strategy=strategy,
            devices=settings.devices,
            precision=precision,
            plugins=plugins,
            loggers=TensorBoardLogger(folder, name=LOGS, version=""),
        )
    except (RuntimeError, ValueError, ImportError, MisconfigurationException) as error:  # the last: fewer GPUs than devices
        raise StageError(f"accelerator {settings.accelerator}, {settings.devices} devices, {settings.precision}: {error}") from error


@contextmanager
def end_children_on_interrupt() -> Iterator[None]:
    """End the processes that are started in this context when it is interrupted; otherwise it would wait for them.

    Their temporary files are in a folder that other users cannot reach: torch unpickles one of them when a process has failed.
    """
    children, environment_folder, tempfile_folder = set(multiprocessing.active_children()), os.environ.get("TMPDIR"), tempfile.tempdir
    with temporary_folder() as folder:
        os.environ["TMPDIR"], tempfile.tempdir = str(folder), None
        try:
            yield
        except KeyboardInterrupt:  # SIGTERM, too
            for child in set(multiprocessing.active_children()) - children:
                child.terminate()
            raise
        finally:
            del os.environ["TMPDIR"]
            os.environ |= {} if environment_folder is None else {"TMPDIR": environment_folder}
            tempfile.tempdir = tempfile_folder


def end_with_parent() -> None:
    """Let this process, started by a training, end when its parent is killed.

    The system then sends SIGINT, as torch asked it to, and a job in a shell's background would ignore that.
    """
    if parent := multiprocessing.parent_process():
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if os.getppid() != parent.pid:  # it was killed before
            os.kill(os.getpid(), signal.SIGINT)


@contextmanager
def lost_peers_as_stage_error(fabric: Fabric, name: str) -> Iterator[None]:
    """Raise a `StageError` if another process of the training ended, after giving its launcher time to report the reason."""
    try:
        yield
    except RuntimeError as error:
        is_lost = "gloo" in str(error) and any(words in str(error) for words in LOST)
        if fabric.world_size == 1 or not (is_lost or isinstance(error, torch.distributed.DistError)):
            raise
        time.sleep(REPORT_DELAY)
        reason = str(error).strip().splitlines()[0]
        raise StageError(
            f"{name}: process {fabric.global_rank} of {fabric.world_size} lost the others ({reason}); see their messages, and {RESUME_HINT}"
        ) from error
