"""Supplement 3.6: the single-image network on the test objects, by Table 4's standard."""

from __future__ import annotations

import json
from typing import Any

from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.models.families import load_reconstructor, model_name
from pipeline.store.directory import DataDirectory
from pipeline.training.device import device_of, torch_threads
from schemas.base import Artifact
from schemas.renderings import RENDERINGS
from schemas.surfaces import SURFACES
from stages.evaluate_single_image.measure import Measurement
from stages.evaluate_single_image.printed_table import METRICS, show
from stages.evaluate_single_image.settings import SingleImageEvaluationSettings
from stages.evaluate_single_image.table_4 import FIGURES, means_by_class

MODEL = model_name("single-image")


class EvaluateSingleImage(DatasetStage):
    """Make Table 4 from the trained model."""

    name = "evaluate-single-image"
    summary = "The single-image network on the test objects: Table 4, beside the published rows."
    settings_type = SingleImageEvaluationSettings

    def inputs(self, settings: SingleImageEvaluationSettings) -> tuple[Artifact, ...]:
        """Name the objects' points and renderings."""
        return (SURFACES, RENDERINGS)

    def models(self, settings: SingleImageEvaluationSettings) -> tuple[str, ...]:
        """Name the model."""
        return (MODEL,)

    def splits(self, settings: SingleImageEvaluationSettings) -> tuple[str, ...]:
        """Name the objects that are measured, and those among which the baselines look."""
        return ("train", "test")

    def writes(self, settings: SingleImageEvaluationSettings) -> str:
        """Name the one evaluation of a data directory."""
        return "evaluation-single-image"

    def cost(self, settings: SingleImageEvaluationSettings, objects: int) -> Cost:
        """Estimate a fifth of the objects, 0.3 s per view."""
        return Cost(seconds=0.06 * settings.views * objects, kilobytes=0.1 * objects)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Measure the network and the baselines, then write and print the tables."""
        settings: SingleImageEvaluationSettings = job.settings
        measurement = Measurement(job)
        with torch_threads(settings.threads):
            network = measurement.of_network(load_reconstructor("single-image", job.models[MODEL], device_of(settings.accelerator)))
        figures = {"network": network, **{f"training object, {how}": found for how, found in measurement.of_baselines().items()}}
        rows, trained = measurement.rows, DataDirectory(job.data).folder(MODEL)
        means = {name: means_by_class(found, rows.categories) for name, found in figures.items()}
        written = {
            "settings": settings.results(),
            "seed": job.seed,
            "manifest": trained.manifest,
            "objects": len(rows),
            "views": measurement.views,
            "training_objects": len(ObjectRows(job.data, ["rendering"], "train")),
            "left_out": rows.left_out,
            "figures": FIGURES,
            "rows": {name: {kind: mean.tolist() for kind, mean in of.items()} for name, of in means.items()},
            "values": {name: dict(zip(rows.object_ids, found.tolist(), strict=True)) for name, found in figures.items()},
        }
        (job.folder / METRICS).write_text(json.dumps(written, indent=1, allow_nan=False))
        show(job.folder, job.console)
        return {"objects": len(rows), "training": trained.facts}
