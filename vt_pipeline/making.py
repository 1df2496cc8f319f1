"""The pipeline from Python: its stages make datasets and trained models, which reconstruct what a robot saw and felt."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from pipeline.engine.executor import Serial
from pipeline.engine.make import make as make_outputs
from pipeline.engine.plan import Made
from pipeline.engine.worker_processes import WorkerProcesses
from pipeline.reconstruct.observation_file import RobotObservation
from stages.registry import DATASET, assignment, make_request

if TYPE_CHECKING:
    from pipeline.reconstruct.predict import Prediction


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
    stated: dict[str, Any] = {"data": str(data), "assignments": assignments, "seed": seed, "units": units, "up": up}
    quiet, answers = console or Console(quiet=True), []
    with Serial() if workers == 1 else WorkerProcesses(workers or 0) as executor:
        for name in DATASET if stage == "dataset" else (stage,):
            request = make_request(name, str(manifest), preset, objects=Path(objects) if objects else None, executor=executor, **stated)
            answers += make_outputs(request, quiet, dry_run=dry_run)
    return answers


def load_observation(path: str | Path) -> RobotObservation:
    """Read an observation file with the photographs that it names; an `InvalidInput` lists all its faults."""
    from pipeline.reconstruct.observation_checks import check  # imports torch, which `touch` does not need

    return check(Path(path)).observation


def reconstruct(
    observation: RobotObservation | str | Path,
    models: str | Path | None = None,
    configuration: str | None = None,
    *,
    resolution: int = 128,
    training_seed: int = 0,
    accelerator: str = "auto",
    seed: int = 0,
) -> "Prediction":
    """Reconstruct the surface of an object that a robot saw or felt.

    Parameters
    ----------
    observation
        From `load_observation`, or a `RobotObservation` of arrays, or the path of an observation file.
    models
        Folder of trained models, DATA/models, or `shipped`: by default, the pretrained networks.
    configuration
        Which of them; by default `occluded-touch`. Of the pretrained networks, each of which accepts any subset of the inputs, the default
        is the one for the object's size.
    resolution
        Edges of the closed mesh along the longest side of its box, 64 to 400.
    training_seed
        Which training of the model, where there are several.
    accelerator
        Where the networks run: "cpu", "cuda", or "auto".
    seed
        Of the chart fitting.

    Returns
    -------
    `closed`, one mesh with colours, and `reconstruction`, the network's surface, both in the observation's frame and unit; and `remarks`.

    Raises
    ------
    InvalidInput
        The observation has faults, of which the message lists all; or the resolution is beyond its limits.
    StageError, StoreError
        There is no such model, or it cannot be used.
    """
    from pipeline.reconstruct import predict

    folder = None if models is None else str(models)
    options = predict.PredictOptions(folder, configuration, training_seed, accelerator, seed, resolution)
    if not isinstance(observation, str | Path | RobotObservation):
        raise TypeError(f"observation is a RobotObservation or the path of an observation file; this is {type(observation).__name__}")
    return predict.reconstruct(Path(observation) if isinstance(observation, str) else observation, options)
