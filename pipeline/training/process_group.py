"""Processes that torchrun or srun started together, each with the same command: the first does the work, the others help it train."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from datetime import timedelta
from functools import cache
from typing import TYPE_CHECKING, Any

from rich.console import Console

from pipeline.engine.folder import join_folder
from pipeline.engine.plan import Plan, Summary
from pipeline.engine.run import run
from pipeline.errors import StageError
from pipeline.store.publish import ShardOutput

if TYPE_CHECKING:  # importing it takes a second
    from torch._C._distributed_c10d import Store

HELP, NOTHING = "help", "nothing"
"""Messages of the first process: the others train with it, or end."""


class HelpDone(Exception):
    """Ends the work of a helping process: the first one continues alone."""


@dataclass(frozen=True)
class ProcessGroup:
    """The processes that were started together, and this one's place among them.

    Attributes
    ----------
    launcher
        The program that started them.
    rank, count
        The number of this process, from 0, and how many there are.
    on_node
        How many there are on each node.
    """

    launcher: str
    rank: int
    count: int
    on_node: int

    def broadcast(self, word: str) -> None:
        """Send a message to the others: `HELP` or `NOTHING`."""
        _store().set("word", word)

    def wait_for_word(self) -> str:
        """Wait for the message of the first process.

        Raises
        ------
        StageError
            The first process has ended.
        """
        try:
            return _store().get("word").decode()
        except RuntimeError as error:
            raise StageError(f"the first of {self.count} processes does not answer ({error}); see its messages") from error


def run_together(plan: Plan[Any], console: Console) -> Summary:
    """Run a plan; that of a dataset stage by all processes of the group: the first makes the folder, the others train with it.

    Errors are those of `run`, and a `StageError` where the first process has ended.
    """
    group = process_group()
    if group is None or isinstance(plan.output, ShardOutput):
        return run(plan, console)
    if group.rank == 0:
        summary = run(plan, console)
        group.broadcast(NOTHING)
        return summary
    if group.wait_for_word() == HELP:
        with suppress(HelpDone):
            join_folder(plan, console)
    return Summary()


@cache
def process_group() -> ProcessGroup | None:
    """Find the group in which this process was started; None if it was started alone.

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
    """Connect to the store of messages beside the training's own; in a step of Slurm the first process holds it, else torchrun."""
    from torch._C._distributed_c10d import PrefixStore
    from torch.distributed.rendezvous import rendezvous

    store, _, _ = next(rendezvous("env://", timeout=timedelta(days=1)))  # checking a large dataset's digests may take hours
    return PrefixStore("vt-pipeline", store)
