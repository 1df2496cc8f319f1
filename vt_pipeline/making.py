"""Datasets and trained models: the pipeline's stages, from Python."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from pipeline.engine.executor import Serial
from pipeline.engine.make import make as make_outputs
from pipeline.engine.plan import Made
from pipeline.engine.worker_processes import WorkerProcesses
from stages.registry import DATASET, assignment, make_request


def make(
    stage: str,
    data: str | Path,
    objects: str | Path | None = None,
    *,
    manifest: str | Path | None = None,
    preset: str = "draft",
    settings: Mapping[str, Any] | None = None,
    seed: int | None = None,
    units: str | None = None,
    up: str | None = None,
    workers: int | None = None,
    dry_run: bool = False,
    console: Console | None = None,
) -> list[Made]:
    """Make the output of a stage, as `vt-pipeline run` does: what is up to date is kept.

    Parameters
    ----------
    stage
        Its name, such as "simulate-grasps" or "train-unet"; or "dataset", the four stages that make a dataset.
    data
        Folder of the dataset, or s3://BUCKET/PREFIX.
    objects
        Folder of mesh files.
    manifest
        Name of a built-in manifest, or path of a YAML file; by default `directory` for a folder of meshes, else `toy`.
    preset
        "draft", "standard" or "paper".
    settings
        By name, of the stage or as "STAGE.SETTING"; they come before the preset's.
    seed
        Root seed; by default the manifest's.
    units, up
        Unit ("mm", "m", …) and upright axis ("y", "z") of the mesh files; by default what they state.
    workers
        Processes; by default one per core, and 1 is this process alone. A script that uses others guards its start by
        `if __name__ == "__main__":`.
    dry_run
        Answer what would be made, and what it costs.
    console
        Where progress is shown; by default nowhere.

    Returns
    -------
    What was made of each shard or folder, in words (`text`) and numbers, with the objects that failed and their reasons.

    Raises
    ------
    InvalidInput
        A name, a setting, a manifest or a description file cannot be used; the message names the remedy.
    StageError, StoreError
        The stage cannot work here; an input is missing, damaged or out of date, or results cannot be stored.

    Examples
    --------
    >>> for made in make("dataset", "data/mugs", "my-meshes", units="mm", workers=1):
    ...     print(made.stage, made.text)
    """
    manifest = manifest or ("toy" if objects is None else "directory")
    assignments = [assignment(name, value) for name, value in (settings or {}).items()]
    quiet, answers = console or Console(quiet=True), []
    with Serial() if workers == 1 else WorkerProcesses(workers or len(os.sched_getaffinity(0))) as executor:
        for name in DATASET if stage == "dataset" else (stage,):
            request = make_request(
                name,
                str(manifest),
                preset,
                data=str(data),
                objects=Path(objects) if objects else None,
                assignments=assignments,
                seed=seed,
                units=units,
                up=up,
                executor=executor,
            )
            answers += make_outputs(request, quiet, dry_run=dry_run)
    return answers
