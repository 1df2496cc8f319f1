"""The processes that a training starts on this machine; a separate module, which only they import."""

import tempfile
from datetime import timedelta
from pathlib import Path

import torch.distributed
from lightning_fabric.strategies.ddp import DDPStrategy

SILENCE = timedelta(minutes=10)
"""Longest wait for an answer of a running process: more than a checkpoint or the reading of a list of items takes.
A killed process is noticed immediately."""


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
