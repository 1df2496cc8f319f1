"""Lightning Fabric as trainings use it; imported when one begins, for that takes seconds."""

import logging
import os
import tempfile
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
from pipeline.training.device import device_of
from pipeline.training.settings import TrainingSettings

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
