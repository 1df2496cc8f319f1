"""Supplement 2.4 and 3.5: every trained model on the test objects, in the tables of the supplement."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.config.manifest import SPLITS
from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.models.families import GRASP_CONFIGURATIONS, load_reconstructor, model_name
from pipeline.models.reconstruction import Reconstructor
from pipeline.store.directory import DataDirectory
from pipeline.store.pieces import Pieces
from pipeline.store.storage import remove
from pipeline.training.device import device_of, torch_threads
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import Arrays, evaluation_name, write_evaluation
from stages.evaluate.ground_truth import Truth
from stages.evaluate.measure import measure, surfaces_group
from stages.evaluate.printed_tables import show, show_training
from stages.evaluate.settings import EvaluationSettings
from stages.evaluate.tables import make_tables

PIECE = "measured"
"""Name of the pieces that a killed run leaves; they lie in a folder of their key."""


class Evaluate(DatasetStage):
    """Make the supplement's tables from trained models."""

    name = "evaluate"
    summary = "Every trained model on the test objects: the supplement's tables, beside its figures."
    settings_type = EvaluationSettings

    def inputs(self, settings: EvaluationSettings) -> tuple[Artifact, ...]:
        """Name what the models are shown, and where the touch sites are."""
        networks = [GRASP_CONFIGURATIONS[name] for name in settings.configurations]
        seen, felt = any(network.image for network in networks), any(network.touch for network in networks)
        return (SURFACES, GRASPS, TOUCH, *([VISION] if seen else []), *([CHARTS] if felt else []))

    def models(self, settings: EvaluationSettings) -> tuple[str, ...]:
        """Name the models."""
        return tuple(model_name(name, settings.training_seed) for name in settings.configurations)

    def splits(self, settings: EvaluationSettings) -> tuple[str, ...]:
        """Name all: measured are only objects that no training saw, but Table 1 counts all."""
        return SPLITS

    def writes(self, settings: EvaluationSettings) -> str:
        """Name the evaluation of a data directory; each training seed has its own."""
        return evaluation_name(settings.training_seed)

    def cost(self, settings: EvaluationSettings, objects: int) -> Cost:
        """Estimate six models: at most 74 reconstructions per object, of about 0.1 s and 15 kB each."""
        return Cost(seconds=7.4 * objects, kilobytes=1100 * objects)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Evaluate model by model, then write and print the tables."""
        settings: EvaluationSettings = job.settings
        device = device_of(settings.accelerator)
        folders = {Path(name).name: folder for name, folder in job.models.items()}
        models = {name: load_reconstructor(name, folder, device) for name, folder in folders.items()}
        truth = Truth(job.data, list(models.values()), settings)
        groups: dict[str, Arrays] = {}
        with torch_threads(settings.threads):
            for name, model in models.items():
                groups |= _measured(name, model, truth, job)
        facts = {Path(name).name: DataDirectory(job.data).folder(name).facts for name in job.models}
        felt = [name for name, model in models.items() if model.touch]
        shut = {name: groups[f"closed/{name}"] for name in models if f"closed/{name}" in groups}
        tables = make_tables(job, truth, {name: groups[f"values/{name}"] for name in models}, felt=felt, facts=facts, shut=shut)
        attributes = {
            "settings": settings.results(),
            "seed": job.seed,
            "split": truth.rows.split,
            "configurations": {name: {"image": model.image, "touch": model.touch} for name, model in models.items()},
            "left_out": truth.rows.left_out,
        }
        write_evaluation(job.folder, tables | groups, attributes)
        show(job.folder, job.console)
        show_training(facts, job.console)
        remove(Pieces(job.folder).folder)
        return {"objects": len(truth), "left_out": len(truth.rows.left_out), "training": facts}


def _measured(name: str, model: Reconstructor, truth: Truth, job: DatasetJob) -> dict[str, Arrays]:
    """Take a model's groups over from a killed run, or measure it and keep them for one."""
    pieces, found = Pieces(job.folder), {}
    kinds = ("values", surfaces_group(model), *(["closed"] if job.settings.closed_resolution else []))
    for group in (f"{kind}/{name}" for kind in kinds):
        facts = pieces.facts(group, PIECE)
        if facts and (kept := pieces.load(group, PIECE, "", facts)):
            found[group] = kept
    if len(found) < len(kinds):
        found = measure(name, model, truth, job)
        for group, arrays in found.items():
            pieces.save(group, PIECE, "", arrays, seconds=0.0)
    return found
