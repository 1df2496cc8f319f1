"""Slurm jobs: scripts with safely quoted arguments, dependencies that follow the stages' inputs, and states of tasks."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import trimesh
import yaml
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.cluster import slurm
from pipeline.cluster.cluster_profile import ClusterProfile, load_cluster
from pipeline.cluster.slurm_jobs import Job, Submission, dependency, plan_jobs, script_of
from pipeline.errors import InvalidInput, StageError, StoreError
from pipeline.formats.description_file import description_path
from pipeline.store.storage import place
from stages.registry import STAGES, load_stage, resolve

EVERY_CONFIGURATION = ("none", "touch", "occluded", "occluded-touch", "unoccluded", "unoccluded-touch")
SHIPPED = load_cluster("slurm")


def plan(*stages: str, assignments: tuple[str, ...] = ()) -> dict[str, Job]:
    jobs = plan_jobs((load_stage(name), resolve(name, "draft", assignments)) for name in STAGES if name in stages)
    return {job.name: job for job in jobs}


def submission(folder: Path, profile: ClusterProfile = SHIPPED, arguments: tuple[str, ...] = (), shards: int = 3) -> Submission:
    return Submission(profile, arguments, shards, folder / ".work/slurm", folder)


def options_of(script: str) -> dict[str, str]:
    lines = [shlex.split(line.removeprefix("#SBATCH --"))[0] for line in script.splitlines() if line.startswith("#SBATCH ")]
    return {name: value for name, _, value in (line.partition("=") for line in lines)}


def dependencies_of(jobs: dict[str, Job]) -> dict[str, str | None]:
    by_output = {job.output: job for job in jobs.values()}
    return {name: dependency(job, by_output, {output: other.name for output, other in by_output.items()}) for name, job in jobs.items()}


def test_every_stage_depends_on_the_makers_of_its_inputs():
    jobs = plan(*STAGES, assignments=("evaluate.configurations=[occluded-touch]",))
    makers = {job.output: job.name for job in jobs.values()}
    for job in jobs.values():
        read = [*(artifact.name for artifact in job.stage.inputs(job.settings)), *job.stage.models(job.settings)]
        dependencies = [name for part in (dependencies_of(jobs)[job.name] or "").split(",") for name in part.split(":")[1:]]
        assert sorted(dependencies) == sorted(makers[name] for name in read), job.name


def test_shard_waits_for_its_own_shard_and_dataset_stages_for_all_shards():
    dependencies = dependencies_of(plan("sample-surfaces", "simulate-grasps", "train-unet", "fit-charts", "evaluate"))
    assert dependencies["simulate-grasps"] == "aftercorr:sample-surfaces"
    assert dependencies["train-unet"] == "afterok:simulate-grasps"
    assert dependencies["fit-charts"] == "aftercorr:simulate-grasps,afterok:train-unet"
    assert str(dependencies["evaluate"]).startswith("afterok:")
    assert "aftercorr" not in str(dependencies["evaluate"])


def test_stage_without_submitted_inputs_has_no_dependency():
    assert dependencies_of(plan("simulate-touch", "render-vision")) == {"render-vision": None, "simulate-touch": None}


def test_each_evaluated_model_has_a_training_job():
    jobs = plan("train-gcn", "evaluate")
    trained = [job for job in jobs.values() if job.stage.name == "train-gcn"]
    assert {job.output for job in trained} == {f"models/gcn/{name}" for name in EVERY_CONFIGURATION}
    assert set(jobs["evaluate"].waits_for) == {job.output for job in trained}
    for job in trained:
        assert resolve("train-gcn", "draft", job.assignments) == job.settings
    assert [job.output for job in plan("train-gcn").values()] == ["models/gcn/occluded-touch"]
    assert plan("train-gcn", "evaluate", assignments=("evaluate.configurations=[none]",)).keys() == {"train-gcn-none", "evaluate"}


def test_object_stage_has_a_task_per_shard_and_dataset_stage_one_gpu_job(tmp_path):
    jobs = plan("simulate-grasps", "train-unet", "fit-charts")
    array = options_of(script_of(jobs["simulate-grasps"], submission(tmp_path, shards=8)))
    assert (array["array"], array["partition"], array["cpus-per-task"], array["mem"], array["time"]) == (
        *("0-7%64", "cpu", "8", "16G", "04:00:00"),
    )
    assert "gres" not in array
    single = options_of(script_of(jobs["train-unet"], submission(tmp_path)))
    assert (single["partition"], single["gres"], single["kill-on-invalid-dep"]) == ("gpu", "gpu:1", "yes")
    assert "array" not in single
    without = SHIPPED.model_copy(update={"gpu": None, "concurrent": None, "account": "lab", "options": ("--qos=long",)})
    assert options_of(script_of(jobs["train-unet"], submission(tmp_path, without)))["partition"] == "cpu"
    options = options_of(script_of(jobs["fit-charts"], submission(tmp_path, without)))
    assert (options["array"], options["account"], options["qos"], options["partition"]) == ("0-2", "lab", "long", "cpu")


def test_stage_with_accelerator_cpu_gets_no_gpu(tmp_path):
    jobs = plan("train-unet", "fit-charts", assignments=("accelerator=cpu",))
    partitions = {name: options_of(script_of(job, submission(tmp_path)))["partition"] for name, job in jobs.items()}
    assert partitions == {"train-unet": "cpu", "fit-charts": "cpu"}


@pytest.mark.parametrize("setup", [(), ("export GREETING='a b'",), ("false",)])
def test_script_passes_arguments_unchanged_and_writes_its_exit_status(setup, tmp_path):
    folder = tmp_path / "it's 100% $HOME"
    (folder / ".work/slurm").mkdir(parents=True)
    arguments = ("--data", str(folder), "--set", "a=[1, 2]; echo $(touch gone)", "--objects", "--x\"'`")
    show = f"{shlex.quote(sys.executable)} -c 'import json, os, sys; print(json.dumps([sys.argv[1:], os.environ.get(\"GREETING\")]))'"
    profile = SHIPPED.model_copy(update={"command": show, "setup": setup})
    script = script_of(plan("simulate-touch")["simulate-touch"], submission(folder, profile, arguments))
    assert options_of(script)["output"] == f"{folder}/.work/slurm/simulate-touch-%A_%a.log".replace("100%", "100%%")
    numbers = {"SLURM_ARRAY_JOB_ID": "12", "SLURM_ARRAY_TASK_ID": "2", "SLURM_JOB_ID": "14"}
    completed = subprocess.run(["bash"], input=script, env=os.environ | numbers, cwd=tmp_path, capture_output=True, text=True, check=False)
    status = (folder / ".work/slurm/12_2.exit").read_text().strip()
    assert int(status) == completed.returncode == (setup == ("false",))
    if completed.returncode == 0:
        passed, greeting = json.loads(completed.stdout)
        assert passed == ["run", "simulate-touch", *arguments, "--workers", "8", "--shards", "3", "--shard", "2"]
        assert greeting == ("a b" if setup else None)
    assert not (tmp_path / "gone").exists()


def test_each_bucket_has_a_separate_folder(tmp_path):
    assert slurm.slurm_folder(place("s3://team-a/toy")) == Path("slurm/team-a-toy")
    assert slurm.slurm_folder(place("s3://team-b")) == Path("slurm/team-b")


def test_folder_with_a_line_break_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="rename the folder"):
        script_of(plan("simulate-touch")["simulate-touch"], submission(tmp_path / "two\nlines"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"queue": "x"}, "there is no entry queue. Its entries are name, summary, cpu, gpu, concurrent, setup"),
        ({"cpu": {"partition": "cpu"}}, "entry cpu.cores is missing"),
        ({"cpu": {"partition": "a b", "cores": 1, "memory": "1G", "time": "60"}}, "cpu.partition: String should match"),
        ({"cpu": {"partition": "cpu", "cores": 0, "memory": "1G", "time": "60"}}, "cpu.cores: Input should be greater than or equal to 1"),
        ({"cpu": {"partition": "cpu", "cores": 1, "memory": 4000, "time": "60"}}, "write it in quotes and with its unit"),
        ({"cpu": {"partition": "cpu", "cores": 1, "memory": "1G", "time": 14400}}, "YAML reads it as the number 14400; write it in quotes"),
        ({"gpu": {"partition": "g", "gpus": 0, "cores": 1, "memory": "1G", "time": "60"}}, "gpu.gpus"),
        ({"setup": ["module load x\nrm -r y"]}, "is not a single line of printable text"),
        *(
            (changes, "is not a single line of printable text, as a job's script needs; remove control characters")
            for changes in (
                *({entry: f"a{one}b"} for entry in ("account", "command") for one in ("\0", "\n", "\x1b", "\u2028")),
                {"account": "a\n"},
                {"options": ["--qos=a\0"]},
                {"cpu": {"partition": "c\x7f", "cores": 1, "memory": "1G", "time": "60"}},
                {"gpu": {"partition": "c\0", "cores": 1, "memory": "1G", "time": "60"}},
            )
        ),
        ({"cpu": {"partition": "cpu", "cores": 1, "memory": "\u0661G", "time": "60"}}, "cpu.memory: String should match"),
        ({"cpu": {"partition": "cpu", "cores": 10**30, "memory": "1G", "time": "60"}}, "cpu.cores: Input should be less than"),
        ({"options": ["--qos=a b"]}, "options.0: String should match"),
        ({"concurrent": 0}, "concurrent: Input should be greater than or equal to 1"),
    ],
)
def test_unusable_cluster_file_is_refused_with_entry_and_remedy(changes, message, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(description_path("cluster", "slurm").read_text()) | changes))
    with pytest.raises(InvalidInput) as error:
        load_cluster(path)
    assert f"cluster file {path}" in str(error.value)
    assert message in str(error.value)


def test_unknown_cluster_is_refused_with_the_built_in_ones():
    with pytest.raises(InvalidInput, match="there is no cluster 'moon'; built in are slurm"):
        load_cluster("moon")


# ---- Slurm's commands, imitated by scripts


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
    jobs = slurm.states_of(folder, slurm.submitted_jobs(folder))
    return {task.task: (task.state, task.why) for job in jobs for task in job.tasks}


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


def test_units_are_passed_to_the_tasks(tmp_path):
    trimesh.creation.box((80, 60, 40)).export(tmp_path / "box.stl")
    command = ["submit", "sample-surfaces", "--manifest", "directory", "--objects", str(tmp_path), "--data", str(tmp_path / "data")]
    result = CliRunner().invoke(app, [*command, "--units", "mm", "--up", "y", "--dry-run"])
    assert result.exit_code == 0, result.output
    assert "--units mm --up y" in result.output


def test_stage_is_not_submitted_again_while_its_job_is_running(programs, tmp_path):
    imitate_sbatch(programs)
    submit(tmp_path, "sample-surfaces", "simulate-grasps")
    imitate(programs, "squeue", said="2|0|PENDING|Dependency\n2|1|RUNNING|None\n2|2|COMPLETED|None")
    with pytest.raises(StageError, match=r"grasps is being made: job 2 has 2 tasks not ended yet; wait for it, or end it with `scancel 2`"):
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
        **{"1_0": "", "1_1": "exit status 3", "1_2": "OUT_OF_MEMORY", "2": "CANCELLED"},
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


# ---- the command line


def vt(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, [*map(str, arguments)])
    return result.exit_code, result.output


def test_status_shows_jobs_and_failed_tasks(programs, tmp_path):
    imitate_sbatch(programs)
    submit(tmp_path, "sample-surfaces", "simulate-grasps")
    imitate(programs, "squeue", said="1|0|COMPLETED|None\n1|1|FAILED|NonZeroExitCode\n1|2|RUNNING|None\n2|0|PENDING|Dependency")
    code, output = vt("status", tmp_path)
    lines = {line.split()[0]: line.split()[1:] for line in output.splitlines() if line.strip()}
    assert code == 0
    assert lines["sample-surfaces"] == ["1", "0", "1", "1", "1", "0"]
    assert lines["simulate-grasps"][:2] == ["2", "1"]
    assert lines["simulate-grasps"][-1] == "Dependency"
    assert "failed sample-surfaces, task 1_1: FAILED (NonZeroExitCode)" in output
    assert "`vt-pipeline submit` with the same arguments" in output
    account: dict[str, Any] = json.loads(vt("status", tmp_path, "--json")[1])["slurm"]
    assert account["surfaces"]["states"] == {"1_0": "done", "1_1": "failed", "1_2": "running"}


def test_dry_run_prints_the_scripts_and_submits_nothing(programs, tmp_path):
    imitate_sbatch(programs)
    data = tmp_path / "data"
    code, output = vt("submit", "sample-surfaces", "train-unet", "--data", data, "--shards", 5, "--seed", 3, "--dry-run")
    assert code == 0, output
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
    code, output = vt("submit", *arguments, "--data", tmp_path / "data")
    assert code == 1
    assert message in " ".join(output.split())
    assert not (tmp_path / "data").exists()
