"""The network that ships, on the test objects of any dataset: rows beside the networks that were trained on it."""

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import Cost, DatasetJob
from pipeline.models.families import ROWS, load_reconstructor, load_rows, model_name, trained_folder
from pipeline.models.observation import stored_camera
from pipeline.models.reconstruction import Reconstructor
from pipeline.models.shipped_weights import DEFAULT, SHIPPED, shipped_models
from pipeline.store.directory import DataDirectory
from pipeline.training.device import device_of
from schemas.charts import CHARTS
from schemas.vision import VISION
from stages.evaluate.grasp_protocol import GraspProtocol
from stages.evaluate.measure import Case
from stages.evaluate.settings import SHIPPED_ROWS, SHIPPED_SCORES, ShippedSettings
from stages.evaluate.stage import Evaluate


class FirstGraspProtocol(GraspProtocol):
    """Measure reconstructions from each object's first grasp alone: a fifth of the time of five grasps."""

    def cases(self, model: Reconstructor) -> list[Case]:
        """List one case per number of grasps."""
        return [replace(case, firsts=(0,)) for case in super().cases(model) if case.first == 0]


class EvaluateShipped(Evaluate):
    """Measure the network that ships as `evaluate` measures the networks of a data directory, and keep its meshes."""

    name = "evaluate-shipped"
    summary = "The network that ships on the test objects: the tables of `evaluate`."
    settings_type = ShippedSettings
    protocol = FirstGraspProtocol

    def rows(self, settings: Any) -> dict[str, str]:
        """Name no model of the data directory."""
        return {}

    def load(self, job: DatasetJob) -> dict[str, Reconstructor]:
        """Load the network that ships, with the inputs of each row."""
        loaded = load_rows(dict.fromkeys(job.settings.configurations, shipped_folder()), device_of(job.settings.accelerator))
        return {SHIPPED_ROWS + name.removeprefix(f"{DEFAULT}-"): network for name, network in loaded.items()}

    def writes(self, settings: Any) -> str:
        """Name the folder."""
        return SHIPPED_SCORES

    def cost(self, settings: Any, objects: int) -> Cost:
        """Estimate five reconstructions of a fifth of the objects, a second and 200 kB each."""
        return Cost(seconds=objects, kilobytes=200 * objects)


def shipped_folder() -> Path:
    """Return the folder of the network that ships; raise a `StageError` if this version has none."""
    return trained_folder(shipped_models(), DEFAULT)


def shipped_digest() -> str:
    """Compute the SHA-256 of its record, which names every file of the weights by its digest; empty if no network ships."""
    record = SHIPPED / f"{model_name(DEFAULT).removeprefix('models/')}.json"
    return hashlib.sha256(record.read_bytes()).hexdigest() if record.exists() else ""


def fitting_rows(directory: DataDirectory) -> tuple[list[str], list[str]]:
    """Choose the rows of `ROWS` whose inputs a dataset has; say why the others are skipped."""
    model = load_reconstructor(DEFAULT, shipped_folder())
    reasons = list(_unfit(directory, model))
    unfit = {kind for kind, _ in reasons}
    rows = []
    for name, (network, inputs) in ROWS.items():
        takes = {*([inputs.image] if inputs.image else []), *(["touch"] if inputs.touch else [])}
        if network == DEFAULT and takes and not takes & unfit:
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
            yield kind, "not all images are from the camera that it knows"
    if not charts.shards:
        yield "touch", "fit-charts has not been run"
    elif (vertices := charts.first.array("vertices").shape[-2]) != model.config.side**2:
        yield "touch", f"charts have {vertices} vertices, it takes {model.config.side**2}"


def _is_seen_as_learned(directory: DataDirectory, model: Reconstructor) -> bool:
    """Check whether all test objects appear from the same side as in the network's training, and as large."""
    rows = ObjectRows(directory.root, ["projection"], "test")
    return all(model.trained.has_view(stored_camera(rows, object_id, model.config)) for object_id in rows.object_ids)
