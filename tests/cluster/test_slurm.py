"""Slurm jobs: scripts with safely quoted arguments, and dependencies that follow the stages' inputs."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh
import yaml

from pipeline.cluster import slurm
from pipeline.cluster.slurm_jobs import Job, dependency, load_cluster, script_of
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path
from pipeline.store.storage import as_location
from stages.registry import STAGES, resolve
from tests.cluster.planned_jobs import SHIPPED, plan, submission
from tests.command_line import vt

EVERY_CONFIGURATION = ("none", "touch", "occluded", "occluded-touch", "unoccluded", "unoccluded-touch")


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


def test_single_image_training_is_no_variant_of_others_with_their_seed():
    jobs = plan("train-gcn", "train-single-image", "evaluate", assignments=("evaluate.training_seed=1",))
    assert [name for name in jobs if name.startswith("train-single-image")] == ["train-single-image"]
    assert all("seed-1" in output for output in jobs["evaluate"].waits_for)


def test_training_that_a_setting_forbids_is_an_error():
    settings = ("train-implicit.encoder_norm=batch", "train-implicit.devices=2", "evaluate.configurations=[implicit-any]")
    with pytest.raises(InvalidInput, match="train-implicit with configuration=implicit-any: "):
        plan("train-implicit", "evaluate", assignments=("train-implicit.configuration=implicit-touch", *settings))


def test_shard_waits_for_its_own_shard_and_dataset_stages_for_all_shards():
    dependencies = dependencies_of(plan("sample-surfaces", "simulate-grasps", "train-unet", "fit-charts", "evaluate"))
    assert dependencies["sample-surfaces"] is None
    assert dependencies["simulate-grasps"] == "aftercorr:sample-surfaces"
    assert dependencies["train-unet"] == "afterok:simulate-grasps"
    assert dependencies["fit-charts"] == "aftercorr:simulate-grasps,afterok:train-unet"
    assert str(dependencies["evaluate"]).startswith("afterok:")
    assert "aftercorr" not in str(dependencies["evaluate"])


def test_each_evaluated_model_has_a_training_job():
    jobs = plan("train-gcn", "evaluate")
    trained = [job for job in jobs.values() if job.stage.name == "train-gcn"]
    assert {job.output for job in trained} == {f"models/gcn/{name}" for name in EVERY_CONFIGURATION}
    assert set(jobs["evaluate"].waits_for) == {job.output for job in trained}
    for job in trained:
        assert resolve("train-gcn", "draft", job.assignments) == job.settings
    assert [job.output for job in plan("train-gcn").values()] == ["models/gcn/occluded-touch"]
    assert plan("train-gcn", "evaluate", assignments=("evaluate.configurations=[none]",)).keys() == {"train-gcn-none", "evaluate"}


def test_evaluated_models_are_trained_with_the_seed_of_the_evaluation():
    jobs = plan("train-gcn", "evaluate", assignments=("evaluate.configurations=[none,touch]", "evaluate.training_seed=1"))
    assert jobs.keys() == {"train-gcn-none-1", "train-gcn-touch-1", "evaluate"}
    assert set(jobs["evaluate"].waits_for) == {"models/seed-1/gcn/none", "models/seed-1/gcn/touch"}
    assert jobs["train-gcn-touch-1"].assignments == ("train-gcn.configuration=touch", "train-gcn.training_seed=1")


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
    assert slurm.slurm_folder(as_location("s3://team-a/toy")) == Path("slurm/s3/team-a/toy")
    assert slurm.slurm_folder(as_location("s3://team-b")) == Path("slurm/s3/team-b")
    assert slurm.slurm_folder(as_location("s3://team-a//toy/")) == Path("slurm/s3/team-a/toy")  # as storage takes it
    assert slurm.slurm_folder(as_location("s3://team/a-toy")) != slurm.slurm_folder(as_location("s3://team/a/toy"))


def test_folder_with_a_line_break_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="rename the folder"):
        script_of(plan("simulate-touch")["simulate-touch"], submission(tmp_path / "two\nlines"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"queue": "x"}, "there is no entry queue. The file's entries are name, summary, cpu, gpu, concurrent, setup"),
        ({"cpu": {"partition": "cpu"}}, "entry cpu.cores is missing"),
        ({"cpu": {"partition": "a b", "cores": 1, "memory": "1G", "time": "60"}}, "cpu.partition: String should match"),
        ({"cpu": {"partition": "cpu", "cores": 0, "memory": "1G", "time": "60"}}, "cpu.cores: Input should be greater than or equal to 1"),
        ({"cpu": {"partition": "cpu", "cores": 1, "memory": 4000, "time": "60"}}, "write it in quotes and with its unit"),
        ({"cpu": {"partition": "cpu", "cores": 1, "memory": "1G", "time": 14400}}, "YAML reads it as the number 14400; write it in quotes"),
        ({"gpu": {"partition": "g", "gpus": 0, "cores": 1, "memory": "1G", "time": "60"}}, "gpu.gpus"),
        ({"setup": ["module load x\nrm -r y"]}, "is not one line of printable text"),
        *(
            (changes, "is not one line of printable text, as a job's script needs; remove control characters")
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


def test_units_are_passed_to_the_tasks(tmp_path):
    trimesh.creation.box((80, 60, 40)).export(tmp_path / "box.stl")
    command = ["submit", "sample-surfaces", "--manifest", "directory", "--objects", str(tmp_path), "--data", str(tmp_path / "data")]
    assert "--units mm --up y" in vt(*command, "--units", "mm", "--up", "y", "--dry-run")
