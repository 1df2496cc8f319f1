"""The Kubernetes template is valid by the API's schema, and its script uses existing options of vt-pipeline."""

import copy
import os
import subprocess
from importlib import resources
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import typer
import yaml

from pipeline.cli import app
from pipeline.cluster.slurm_jobs import load_cluster

JOB: dict[str, Any] = yaml.safe_load((resources.files("pipeline") / "assets" / "kubernetes-job.yaml").read_text())
(CONTAINER,) = JOB["spec"]["template"]["spec"]["containers"]
VALUES = {entry["name"]: entry.get("value") for entry in CONTAINER["env"]}


@pytest.mark.parametrize("version", ["1.29", "1.37"])
def test_template_is_valid_by_the_api_schema(version):
    kubernetes_validate.validate(JOB, version, strict=True)


def test_misspelt_entry_is_refused_by_the_api_schema():
    misspelt = copy.deepcopy(JOB)
    misspelt["spec"]["completionmode"] = misspelt["spec"].pop("completionMode")
    with pytest.raises(kubernetes_validate.ValidationError, match="completionmode"):
        kubernetes_validate.validate(misspelt, "1.37", strict=True)


def test_job_has_a_pod_per_shard():
    assert VALUES["SHARDS"] == str(JOB["spec"]["completions"])


def test_limit_of_memory_per_core_is_that_of_the_slurm_template():
    task, pod = load_cluster("slurm").cpu, CONTAINER["resources"]
    per_core = int(pod["limits"]["memory"].removesuffix("Gi")) / int(pod["requests"]["cpu"])
    assert per_core == int(task.memory.removesuffix("G")) / task.cores


def test_script_runs_each_stage_for_its_shard_until_one_fails(tmp_path: Path):
    program = tmp_path / "vt-pipeline"
    program.write_text('#!/bin/bash\necho "$@"\n[ "$2" != render-vision ]\n')
    program.chmod(0o755)
    variables = {name: value or "8" for name, value in VALUES.items()}  # Kubernetes fills in the number of cores
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "JOB_COMPLETION_INDEX": "5", **variables}
    command = [*CONTAINER["command"], *CONTAINER["args"]]
    completed = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert completed.returncode == 1
    lines = [line.split() for line in completed.stdout.splitlines()]
    assert [line[:2] for line in lines] == [["run", stage] for stage in ("sample-surfaces", "simulate-grasps", "render-vision")]
    group: Any = typer.main.get_command(app)
    run = group.get_command(None, "run")
    for line in lines:
        parameters = run.make_context("run", line[1:]).params
        assert (parameters["shard"], parameters["shards"], parameters["workers"]) == (5, JOB["spec"]["completions"], 8)
