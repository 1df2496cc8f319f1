"""Every stage on a real Slurm of one node, as `make test-slurm` runs it: the digests are those of a serial run, whatever was killed.

The file's name keeps it from being collected by `make test`: it starts daemons, as root.
"""

import json
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from checks.slurm.one_node import one_node_slurm
from pipeline.cluster import slurm
from stages.registry import GRASP_STAGES
from tests.test_pipeline import ASSIGNMENTS, SHARDED, vt

SHARDS = 3
SECONDS = 600
PROFILE = {
    "name": "one-node",
    "cpu": {"partition": "cpu", "cores": 1, "memory": "1500M", "time": "00:30:00"},
    "concurrent": 2,
    "setup": ["export OMP_NUM_THREADS=1"],
}
SETTINGS = [*ASSIGNMENTS, "evaluate.configurations=[none,touch]"]


@pytest.fixture(scope="module", autouse=True)
def cluster() -> Iterator[None]:
    with tempfile.TemporaryDirectory(prefix="slurm", dir="/tmp") as folder, one_node_slurm(Path(folder)):
        yield


@pytest.fixture(scope="module")
def asked(tmp_path_factory) -> list[str]:
    """Return the arguments of a run: five modelled objects, small settings."""
    folder = tmp_path_factory.mktemp("manifest with a space")
    sources = [{"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"bottle": 2, "knife": 3}}]
    splits = {"train": 0.6, "valid": 0.2, "test": 0.2}
    described = {"name": "five", "description": "d", "seed": 0, "splits": splits, "sources": sources}
    (folder / "five.yaml").write_text(yaml.safe_dump(described))
    (folder / "one-node.yaml").write_text(yaml.safe_dump(PROFILE))
    return ["--manifest", str(folder / "five.yaml"), *(part for assignment in SETTINGS for part in ("--set", assignment))]


@pytest.fixture(scope="module")
def serial(asked, tmp_path_factory) -> dict[str, str]:
    """Compute the digests of a run without Slurm and without shards."""
    data = tmp_path_factory.mktemp("serial")
    for stage in GRASP_STAGES:
        for more in ([], ["--set", "train-gcn.configuration=none"], ["--set", "train-gcn.configuration=touch"]):
            if (stage == "train-gcn") == bool(more):
                vt("run", stage, *asked, *more, "--data", data, "--executor", "serial")
    return digests(data)


def submit(asked: list[str], data: Path, *stages: str, shards: int = SHARDS) -> str:
    cluster = Path(asked[1]).with_name("one-node.yaml")
    return vt("submit", *stages, *asked, "--data", data, "--shards", str(shards), "--cluster", cluster)


def account(data: Path) -> dict[str, dict[str, object]]:
    found: dict[str, dict[str, object]] = json.loads(vt("status", data, "--json"))
    return found


def digests(data: Path) -> dict[str, str]:
    return {name: str(one["digest"]) for name, one in account(data).items() if name != "slurm"}


def wait_until(data: Path, what: Callable[[dict[str, str]], bool]) -> dict[str, str]:
    """Wait until the tasks' states satisfy `what`, and return them."""
    deadline, folder = time.monotonic() + SECONDS, slurm.slurm_folder(data)
    while True:
        states = {task: state for task, (state, _) in slurm.task_states(folder, slurm.submitted_jobs(folder)).items()}
        if what(states):
            return dict(states)
        assert time.monotonic() < deadline, states
        time.sleep(0.1)


def ended(states: dict[str, str]) -> bool:
    return not {"pending", "running"} & set(states.values())


def test_all_stages_at_once_give_the_digests_of_a_serial_run(asked, serial, tmp_path):
    data = tmp_path / "it's 100% data"
    began = time.monotonic()
    submit(asked, data, *GRASP_STAGES)
    states = wait_until(data, ended)
    print(f"{len(states)} tasks took {time.monotonic() - began:.0f} s")
    assert set(states.values()) == {"done"}, vt("status", data)
    assert len(states) == SHARDS * len(SHARDED) + len(["train-unet", "train-touch", "none", "touch", "train-implicit", "evaluate"])
    assert digests(data) == serial
    submit(asked, data, "simulate-touch")
    wait_until(data, ended)
    logs = [path.read_text() for path in slurm.slurm_folder(data).glob("simulate-touch-*.log")]
    assert sum("up to date" in text for text in logs) == SHARDS


def test_a_killed_task_is_seen_and_submitted_again_gives_equal_digests(asked, serial, tmp_path):
    stages = ["sample-surfaces", "simulate-grasps", "simulate-touch"]
    submit(asked, tmp_path, *stages)
    victim = next(job.number for job in slurm.submitted_jobs(slurm.slurm_folder(tmp_path)) if job.stage == "simulate-grasps") + "_1"
    wait_until(tmp_path, lambda states: states[victim] == "running" and any((tmp_path / ".work/grasps/rows").glob("*/*")))
    with pytest.raises(AssertionError, match="makes grasps, tasks left"):
        submit(asked, tmp_path, "simulate-grasps")
    subprocess.run(["scancel", victim], check=True)
    states = wait_until(tmp_path, ended)
    failed = {task for task, state in states.items() if state == "failed"}
    said = vt("status", tmp_path)
    assert len(failed) == 2  # and what waits for it
    assert f"failed simulate-grasps, task {victim}: CANCELLED" in said
    assert "DependencyNeverSatisfied" in said
    submit(asked, tmp_path, *stages)
    assert set(wait_until(tmp_path, ended).values()) == {"done"}, vt("status", tmp_path)
    assert digests(tmp_path) == {name: serial[name] for name in ("surfaces", "grasps", "touch")}


def test_what_slurm_refuses_is_told_in_its_words(asked, tmp_path):
    path = tmp_path / "other.yaml"
    path.write_text(yaml.safe_dump(PROFILE | {"options": ["--qos=none", "--partition=moon"]}))
    with pytest.raises(AssertionError, match=r"sbatch refuses .*nvalid partition"):
        vt("submit", "sample-surfaces", *asked, "--data", tmp_path / "data", "--cluster", path)
