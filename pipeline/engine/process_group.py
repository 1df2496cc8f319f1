"""Processes that torchrun or srun started together, each with the same command: the first makes what is made once, the others help it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import timedelta
from functools import cache
from typing import TYPE_CHECKING

from pipeline.errors import StageError

if TYPE_CHECKING:  # importing it takes a second
    from torch._C._distributed_c10d import Store

HELP, NOTHING = "help", "nothing"
"""What the first process tells the others of an output."""


class HelpDone(Exception):
    """Ends the work of a process that helped: the first one goes on alone."""


@dataclass(frozen=True)
class ProcessGroup:
    """The processes that were started together, and which of them this is.

    Attributes
    ----------
    launcher
        What started them.
    rank, count
        The number of this process, from 0, and how many there are.
    on_node
        How many there are on each node.
    """

    launcher: str
    rank: int
    count: int
    on_node: int

    def broadcast(self, what: str, word: str) -> None:
        """Tell the others whether the first process wants `HELP` with an output, or `NOTHING`."""
        _store().set(what, word)

    def wait_for(self, what: str) -> str:
        """Wait for the word of the first process.

        Raises
        ------
        StageError
            The first process has ended.
        """
        try:
            return _store().get(what).decode()
        except RuntimeError as error:
            raise StageError(f"{what}: the first of {self.count} processes does not answer ({error}); see what it says") from error


@cache
def process_group() -> ProcessGroup | None:
    """Find out what started this process with others; None where it was started alone.

    Slurm's names are translated to those of torchrun, which torch and Fabric read.
    """
    environment = os.environ
    if "TORCHELASTIC_RUN_ID" not in environment:
        if int(environment.get("SLURM_STEP_NUM_TASKS", 1)) < 2:  # of this step of the job: srun sets it, sbatch does not
            return None
        environment.update(_names_of_torchrun(environment["SLURM_STEP_NODELIST"]))
    rank, count, on_node = (int(environment[name]) for name in ("RANK", "WORLD_SIZE", "LOCAL_WORLD_SIZE"))
    return ProcessGroup("torchrun" if "TORCHELASTIC_RUN_ID" in environment else "srun", rank, count, on_node)


def _names_of_torchrun(nodes: str) -> dict[str, str]:
    from lightning_fabric.plugins.environments.slurm import SLURMEnvironment

    slurm = {name: int(os.environ[f"SLURM_{name}"]) for name in ("PROCID", "LOCALID", "NODEID", "STEP_NUM_TASKS", "STEP_NUM_NODES")}
    job, step = int(os.environ["SLURM_JOB_ID"]), int(os.environ["SLURM_STEP_ID"])
    return {
        "RANK": str(slurm["PROCID"]),
        "LOCAL_RANK": str(slurm["LOCALID"]),
        "GROUP_RANK": str(slurm["NODEID"]),
        "WORLD_SIZE": str(slurm["STEP_NUM_TASKS"]),
        "LOCAL_WORLD_SIZE": str(slurm["STEP_NUM_TASKS"] // slurm["STEP_NUM_NODES"]),
        "MASTER_ADDR": os.environ.get("MASTER_ADDR") or SLURMEnvironment.resolve_root_node_address(nodes),
        "MASTER_PORT": os.environ.get("MASTER_PORT") or str(15000 + (16 * job + step) % 15000),
    }


@cache
def _store() -> Store:
    """Connect to the store of words beside the training's own; in a step of Slurm the first process holds it, else torchrun."""
    from torch._C._distributed_c10d import PrefixStore
    from torch.distributed.rendezvous import rendezvous

    store, _, _ = next(rendezvous("env://", timeout=timedelta(days=1)))  # checking a large dataset's digests may take hours
    return PrefixStore("vt-pipeline", store)
