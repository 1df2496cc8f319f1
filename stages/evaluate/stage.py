"""Supplement 2.4 and 3.5: every trained model on the test objects, in the tables of the supplement."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.config.manifest import SPLITS
from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from pipeline.models.reconstruction import Reconstructor
from pipeline.store.directory import DataDirectory
from pipeline.training.device import device_of
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.measure import measure
from stages.evaluate.printed_tables import show, show_training
from stages.evaluate.settings import EvaluationSettings
from stages.evaluate.store import Arrays, discard_partials, load_partial, save_partial, write_evaluation
from stages.evaluate.tables import make_tables
from stages.evaluate.truth import Truth

MODELS = "models/gcn"


class Evaluate(DatasetStage):
    """From trained models to the supplement's tables."""

    name = "evaluate"
    summary = "Every trained model on the test objects: the supplement's tables, beside its figures."
    settings_type = EvaluationSettings

    def inputs(self, settings: EvaluationSettings) -> tuple[Artifact, ...]:
        """What the models named are shown, and where the touch sites are."""
        networks = [CONFIGURATIONS[name] for name in settings.configurations]
        seen, felt = any(network.image for network in networks), any(network.touch for network in networks)
        return (SURFACES, GRASPS, TOUCH, *([VISION] if seen else []), *([CHARTS] if felt else []))

    def models(self, settings: EvaluationSettings) -> tuple[str, ...]:
        """The models named."""
        return tuple(f"{MODELS}/{name}" for name in settings.configurations)

    def splits(self, settings: EvaluationSettings) -> tuple[str, ...]:
        """Measured are only objects that no training saw; Table 1 counts all."""
        return SPLITS

    def folder(self, settings: EvaluationSettings) -> str:
        """One evaluation a data directory."""
        return "evaluation"

    def cost(self, settings: EvaluationSettings, objects: int) -> Cost:
        """Six models, at most 74 reconstructions an object, of about 0.1 s and 15 kB each."""
        return Cost(seconds=7.4 * objects, kilobytes=1100 * objects)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Evaluate model by model, then write and print the tables."""
        settings: EvaluationSettings = job.settings
        device = device_of(settings.accelerator)
        folders = {Path(name).name: folder for name, folder in job.models.items()}
        models = {name: Reconstructor(folder, device) for name, folder in folders.items()}
        truth = Truth(job.data, list(models.values()), settings)
        found = {name: _measured(name, model, truth, job) for name, model in models.items()}
        facts = {Path(name).name: DataDirectory(job.data).folder(name).facts for name in job.models}
        felt = [name for name, model in models.items() if model.touch]
        tables = make_tables(job, truth, {name: groups["values"] for name, groups in found.items()}, felt=felt, facts=facts)
        groups = {f"{group}/{name}": arrays for name, groups in found.items() for group, arrays in groups.items()}
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
        discard_partials(job.folder)
        return {"objects": len(truth), "left_out": len(truth.rows.left_out), "training": facts}


def _measured(name: str, model: Reconstructor, truth: Truth, job: DatasetJob) -> dict[str, Arrays]:
    """Take a model's groups over from a killed run, or measure it and keep them for one."""
    if (kept := load_partial(job.folder, name)) is not None:
        return kept
    groups = measure(name, model, truth, job)
    save_partial(job.folder, name, groups)
    return groups
