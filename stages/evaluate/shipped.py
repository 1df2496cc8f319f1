"""The pretrained network on the test objects of any dataset: rows beside the networks that were trained on it."""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.config.settings import setting
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import Cost, DatasetJob
from pipeline.models.families import ROWS, load_reconstructor, load_rows, model_name, rows_of, trained_folder
from pipeline.models.observation import stored_camera
from pipeline.models.reconstruction import Reconstructor
from pipeline.models.shipped_weights import DEFAULT, SHIPPED, shipped_models
from pipeline.store.directory import DataDirectory
from pipeline.training.device import device_of
from schemas.charts import CHARTS
from schemas.vision import VISION
from stages.evaluate.evaluation_files import SHIPPED_ROWS, SHIPPED_SCORES
from stages.evaluate.reconstructors import Network
from stages.evaluate.stage import Evaluate, GraspMeasuringSettings


class ShippedSettings(GraspMeasuringSettings):
    """Choose the inputs of the pretrained network; these settings are those of `vt-pipeline report --shipped`."""

    configurations: tuple[str, ...] = setting(..., "its inputs: rows of the tables", changes="definition")
    weights: str = setting(..., "SHA-256 of the record of the weights", changes="definition")
    learned_from: tuple[str, ...] = setting((), "test objects that it has learned from", changes="definition")


class EvaluateShipped(Evaluate):
    """Measure the pretrained network as `evaluate` measures the networks of a data directory, and keep its meshes."""

    name = "evaluate-shipped"
    summary = "The pretrained network on the test objects: the tables of `evaluate`."
    settings_type = ShippedSettings

    def models(self, settings: Any) -> tuple[str, ...]:
        """Name no model of the data directory."""
        return ()

    def reconstructors(self, job: DatasetJob) -> list[Network]:
        """Load the pretrained network, with the inputs of each row."""
        loaded = load_rows(dict.fromkeys(job.settings.configurations, shipped_folder()), device_of(job.settings.accelerator))
        return [Network(SHIPPED_ROWS + name.removeprefix(f"{DEFAULT}-"), model, first_only=True) for name, model in loaded.items()]

    def writes(self, settings: Any) -> str:
        return SHIPPED_SCORES

    def cost(self, settings: Any, objects: int) -> Cost:
        """Estimate five reconstructions of a fifth of the objects, a second and 200 kB each."""
        return Cost(seconds=objects, kilobytes=200 * objects)


def shipped_folder() -> Path:
    """Return the folder of the pretrained network; raise a `StageError` if this version has none."""
    return trained_folder(shipped_models(), DEFAULT)


def shipped_digest() -> str:
    """Compute the SHA-256 of its record, which names every file of the weights by its digest; empty if there is none."""
    record = SHIPPED / f"{model_name(DEFAULT).removeprefix('models/')}.json"
    return hashlib.sha256(record.read_bytes()).hexdigest() if record.exists() else ""


def fitting_rows(directory: DataDirectory) -> tuple[list[str], list[str]]:
    """Choose the rows whose inputs a dataset has; say why the others are skipped."""
    model = load_reconstructor(DEFAULT, shipped_folder())
    reasons = list(_unfit(directory, model))
    unfit = {kind for kind, _ in reasons}
    rows = []
    for name in rows_of(DEFAULT):
        inputs = ROWS[name].inputs
        takes = {*([inputs.image] if inputs.image else []), *(["touch"] if inputs.touch else [])}
        if takes and not takes & unfit:
            rows.append(name)
    return rows, [f"{kind}: {why}" for kind, why in reasons]


def _unfit(directory: DataDirectory, model: Reconstructor) -> Iterator[tuple[str, str]]:
    """Name the inputs that the dataset cannot give it, with the reason."""
    images, charts = directory.collection(VISION), directory.collection(CHARTS)
    is_seen_as_learned = bool(images.shards) and _is_seen_as_learned(directory, model)
    for kind in ("occluded", "unoccluded"):
        if not images.shards or (kind == "occluded" and not images.first.has(kind)):
            yield kind, "render-vision has not made it"
        elif not is_seen_as_learned:
            yield kind, "not all images are from the camera that it was trained with"
    if not charts.shards:
        yield "touch", "fit-charts has not been run"
    elif (vertices := charts.first.array("vertices").shape[-2]) != model.config.side**2:
        yield "touch", f"charts have {vertices} vertices, it takes {model.config.side**2}"


def _is_seen_as_learned(directory: DataDirectory, model: Reconstructor) -> bool:
    """Check whether all test objects appear from the same side as in the network's training, and as large."""
    rows = ObjectRows(directory.root, ["projection"], "test")
    return all(model.trained.has_view(stored_camera(rows, object_id, model.config)) for object_id in rows.object_ids)
