"""Process groups, read from the environment."""

from __future__ import annotations

import os
from collections.abc import Iterator

import lightning_fabric  # noqa: F401 (it keeps the rank that it finds when it is first imported, for all tests after these)
import pytest

from pipeline.training.process_group import ProcessGroup, process_group

STEP = {"STEP_NUM_TASKS": "4", "STEP_NUM_NODES": "2", "STEP_NODELIST": "node[07-08]", "PROCID": "2", "LOCALID": "0", "NODEID": "1"}
TORCHRUN = {"RANK": "1", "WORLD_SIZE": "3", "LOCAL_WORLD_SIZE": "3", "LOCAL_RANK": "1", "GROUP_RANK": "0"}


@pytest.fixture(autouse=True)
def clean(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Clear the cached process group and restore the environment."""
    for name in (*TORCHRUN, "TORCHELASTIC_RUN_ID", "MASTER_ADDR", "MASTER_PORT", *(f"SLURM_{name}" for name in STEP)):
        monkeypatch.setenv(name, "")  # so that it is removed afterwards
        monkeypatch.delenv(name)
    process_group.cache_clear()
    yield
    process_group.cache_clear()


def test_single_process_has_no_process_group() -> None:
    assert process_group() is None


def test_process_group_is_read_from_torchruns_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"TORCHELASTIC_RUN_ID": "none", **TORCHRUN}.items():
        monkeypatch.setenv(name, value)
    assert process_group() == ProcessGroup("torchrun", rank=1, count=3, on_node=3)


def test_slurm_step_with_several_tasks_is_a_process_group(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {**STEP, "JOB_ID": "5", "STEP_ID": "1"}.items():
        monkeypatch.setenv(f"SLURM_{name}", value)
    assert process_group() == ProcessGroup("srun", rank=2, count=4, on_node=2)
    assert [os.environ[name] for name in ("MASTER_ADDR", "MASTER_PORT", "LOCAL_RANK", "GROUP_RANK")] == ["node07", "15081", "0", "1"]


def test_sbatch_script_has_no_process_group(monkeypatch: pytest.MonkeyPatch) -> None:
    """The environment holds the tasks of the job, but the script is one process."""
    for name, value in {"JOB_ID": "5", "NTASKS": "4", "PROCID": "0", "LOCALID": "0"}.items():
        monkeypatch.setenv(f"SLURM_{name}", value)
    assert process_group() is None
