"""Jobs submitted to Slurm, whose commands scripts imitate: recorded, not submitted twice, and their states."""

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from pipeline.cluster import slurm
from pipeline.errors import StageError, StoreError
from tests.cluster.planned_jobs import plan, submission
from tests.command_line import vt


@pytest.fixture
def programs(tmp_path, monkeypatch) -> Path:
    """Make a folder of programs, first on PATH."""
    folder = tmp_path / "programs"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    imitate(folder, "sacct", 1, "", "Slurm accounting storage is disabled")
    imitate(folder, "squeue", 1, "", "slurm_load_jobs error: Invalid job id specified")
    return folder


def imitate(folder: Path, name: str, status: int = 0, said: str = "", wrong: str = "") -> None:
    asked = f'echo {name} "$@" >> {folder / "asked"}\n'
    (folder / name).write_text(f"#!/bin/sh\n{asked}echo {shlex.quote(said)}\necho {shlex.quote(wrong)} >&2\nexit {status}\n")
    (folder / name).chmod(0o755)


def imitate_sbatch(folder: Path) -> None:
    """Imitate an `sbatch` that numbers jobs from 1."""
    imitate(folder, "sbatch")
    count = f"grep -c ^sbatch {folder / 'asked'}"
    (folder / "sbatch").write_text(f'#!/bin/sh\necho sbatch "$@" >> {folder / "asked"}\n{count}\n')


def states(data: Path, *asked: str) -> dict[str, tuple[str, str]]:
    folder = slurm.slurm_folder(data)
    return slurm.task_states(folder, slurm.submitted_jobs(folder))


def submit(data: Path, *stages: str) -> list[slurm.SubmittedJob]:
    return list(slurm.submit(list(plan(*stages).values()), submission(data)))


def test_jobs_are_submitted_with_dependencies_and_recorded(programs, tmp_path):
    imitate_sbatch(programs)
    jobs = submit(tmp_path, "sample-surfaces", "simulate-grasps", "train-unet")
    assert [(job.name, job.number, job.tasks) for job in jobs] == [
        ("sample-surfaces", "1", 3),
        ("simulate-grasps", "2", 3),
        ("train-unet", "3", None),
    ]
    commands = [line.split()[2:] for line in (programs / "asked").read_text().splitlines() if line.startswith("sbatch")]
    folder = tmp_path / ".work/slurm"
    assert commands == [
        [f"{folder}/sample-surfaces.sh"],
        ["--dependency=aftercorr:1", f"{folder}/simulate-grasps.sh"],
        ["--dependency=afterok:2", f"{folder}/train-unet.sh"],
    ]
    assert slurm.submitted_jobs(folder) == tuple(jobs)


def test_stage_is_not_submitted_again_while_its_job_is_running(programs, tmp_path):
    imitate_sbatch(programs)
    submit(tmp_path, "sample-surfaces", "simulate-grasps")
    imitate(programs, "squeue", said="2|0|PENDING|Dependency\n2|1|RUNNING|None\n2|2|COMPLETED|None")
    with pytest.raises(StageError, match=r"job 2 makes .*grasps, tasks left: 2; wait, or `scancel 2`"):
        submit(tmp_path, "simulate-grasps")
    assert [job.number for job in submit(tmp_path, "sample-surfaces")] == ["3"]


def test_refused_job_is_reported_with_the_jobs_submitted_before_it(programs, tmp_path):
    imitate(programs, "sbatch", 1, wrong="sbatch: error: invalid partition specified: cpu")
    with pytest.raises(StageError, match=r"sbatch refuses .*surfaces.sh: sbatch: error: invalid partition specified: cpu. Partition"):
        submit(tmp_path, "sample-surfaces")
    imitate(programs, "sbatch")
    (programs / "sbatch").write_text('#!/bin/sh\ncase "$*" in *grasps*) echo no >&2; exit 1;; esac; echo 7\n')
    with pytest.raises(StageError, match=r"`scancel 7` ends what was submitted before it"):
        submit(tmp_path, "sample-surfaces", "simulate-grasps")
    assert [job.number for job in slurm.submitted_jobs(tmp_path / ".work/slurm")] == ["7"]


def test_task_states_come_from_slurm_or_from_files_of_the_task(programs, tmp_path):
    imitate_sbatch(programs)
    submit(tmp_path, "sample-surfaces", "train-unet")
    folder = tmp_path / ".work/slurm"
    imitate(programs, "squeue", said="1|0|RUNNING|None\n1|1|TIMEOUT|TimeLimit\n1|2|COMPLETING|None\n2|N/A|PENDING|Dependency")
    assert states(tmp_path) == {
        "1_0": ("running", ""),
        "1_1": ("failed", "TIMEOUT (TimeLimit)"),
        "1_2": ("running", ""),
        "2": ("pending", "Dependency"),
    }
    imitate(programs, "squeue", 1, wrong="slurm_load_jobs error: Invalid job id specified")
    (folder / "1_0.exit").write_text("0\n")
    (folder / "1_1.exit").write_text("3\n")
    (folder / "sample-surfaces-1_2.log").write_text("half")
    assert states(tmp_path) == {
        "1_0": ("done", ""),
        "1_1": ("failed", "exit status 3"),
        "1_2": ("failed", "it was ended before it was finished"),
        "2": ("failed", "it was cancelled before it began"),
    }
    imitate(programs, "sacct", said="1_2|OUT_OF_MEMORY\n2|CANCELLED by 1000")
    assert {task: state[1] for task, state in states(tmp_path).items()} == {
        **{"1_0": "", "1_1": "exit status 3", "1_2": "OUT_OF_MEMORY", "2": "CANCELLED"}
    }


def test_task_states_are_unknown_when_slurm_does_not_answer(programs, tmp_path, monkeypatch):
    imitate_sbatch(programs)
    submit(tmp_path, "sample-surfaces")
    (tmp_path / ".work/slurm/1_0.exit").write_text("0\n")
    with monkeypatch.context() as elsewhere:
        elsewhere.setenv("PATH", str(tmp_path))
        task_states = states(tmp_path)
    assert task_states["1_0"] == ("done", "")
    assert task_states["1_1"] == ("unknown", "squeue does not answer: squeue is not installed here")
    imitate(programs, "squeue", 1, wrong="slurm_load_jobs error: Unable to contact slurm controller")
    imitate(programs, "sacct", 1)
    assert states(tmp_path)["1_2"][0] == "unknown"


def test_damaged_list_of_jobs_is_reported_with_the_remedy(tmp_path):
    (tmp_path / "jobs.json").write_text('{"jobs": [{"stage": 1}]}')
    with pytest.raises(StoreError, match=r"jobs.json is damaged .* delete it"):
        slurm.submitted_jobs(tmp_path)


def test_status_shows_jobs_and_failed_tasks(programs, tmp_path):
    imitate_sbatch(programs)
    submit(tmp_path, "sample-surfaces", "simulate-grasps")
    imitate(programs, "squeue", said="1|0|COMPLETED|None\n1|1|FAILED|NonZeroExitCode\n1|2|RUNNING|None\n2|0|PENDING|Dependency")
    output = vt("status", tmp_path)
    assert re.search(r" sample-surfaces 1 0 1 1 1 0 simulate-grasps 2 1 [\d ]*Dependency ", output)
    assert "failed sample-surfaces, task 1_1: FAILED (NonZeroExitCode)" in output
    assert "`vt-pipeline submit` with the same arguments" in output
    account: dict[str, Any] = json.loads(vt("status", tmp_path, "--json"))["slurm"]
    assert account["surfaces"]["states"] == {"1_0": "done", "1_1": "failed", "1_2": "running"}


def test_dry_run_prints_the_scripts_and_submits_nothing(programs, tmp_path):
    imitate_sbatch(programs)
    data = tmp_path / "data"
    output = vt("submit", "sample-surfaces", "train-unet", "--data", data, "--shards", 5, "--seed", 3, "--dry-run")
    assert output.count("#!/bin/bash") == 2
    assert "#SBATCH --array=0-4%64" in output
    assert f"--data {data} --seed 3 --workers 8 --shards 5 --shard" in output
    assert not data.exists()
    assert not (programs / "asked").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["fly"], "unknown stage fly; choose from sample-surfaces"),
        (["sample-surfaces", "--set", "points=many"], "points: Input should be a valid integer"),
        (["sample-surfaces", "--cluster", "moon"], "there is no cluster 'moon'"),
        (["sample-surfaces"], "sbatch is not installed here; submit on a machine of the cluster, or print the scripts with --dry-run"),
    ],
)
def test_error_names_the_remedy(arguments, message, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert message in vt("submit", *arguments, "--data", tmp_path / "data", fails=True)
    assert not (tmp_path / "data").exists()
