"""Trained models on the test objects: by the supplement's tables (2.4, 3.5), and single images by Table 4's standard (3.6)."""

import json
import shlex
import shutil
from abc import abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from rich.markup import escape

from pipeline.config.manifest import SPLITS
from pipeline.dataset.touch_statistics import has_paper_sizes
from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.models.families import inputs_of, load_rows, model_name
from pipeline.models.reconstruction import Reconstructor
from pipeline.store.directory import DataDirectory
from pipeline.store.rows import Result, RowFiles
from pipeline.training.device import device_of, torch_threads
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.renderings import RENDERINGS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import METRICS, Arrays, Figure, Figures, evaluation_name, long_table, write_evaluation
from stages.evaluate.grasp_protocol import GraspProtocol
from stages.evaluate.measure import Protocol, measure, surfaces_group
from stages.evaluate.settings import EvaluationSettings, GraspMeasuringSettings, SingleImageEvaluationSettings
from stages.evaluate.single_image_protocol import SingleImageProtocol
from stages.evaluate.tables import evaluation_tables

MEASURED = "measured"
"""Folder of the row files of finished models, which a killed run leaves."""


class NetworkEvaluation(DatasetStage):
    """Measure trained models by a protocol."""

    protocol: ClassVar[Callable[..., Protocol]]

    @abstractmethod
    def rows(self, settings: Any) -> dict[str, str]:
        """Name the folder of the model of each row of the tables."""

    def models(self, settings: Any) -> tuple[str, ...]:
        """Name the models, of which one may have several rows."""
        return tuple(dict.fromkeys(self.rows(settings).values()))

    def attributes(self, job: DatasetJob, protocol: Any) -> dict[str, Any]:
        """Return further attributes of the evaluation's root; by default none."""
        return {}

    def load(self, job: DatasetJob) -> dict[str, Reconstructor]:
        """Load the network of each row."""
        folders = {name: job.models[model] for name, model in self.rows(job.settings).items()}
        return load_rows(folders, device_of(job.settings.accelerator))

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Measure model by model, then the baselines, and write the tables."""
        models = self.load(job)
        protocol = self.protocol(job, list(models.values()))
        figures: dict[str, Figures] = {}
        groups: dict[str, Mapping[str, Any]] = {"objects": protocol.objects.table(), **protocol.extra()}
        with torch_threads(job.settings.threads):
            for name, model in models.items():
                rows, surfaces = _measured(name, model, protocol, job)
                figures[name] = Figures(protocol.objects.rows.object_ids, rows)
                groups |= {f"{surfaces_group(model)}/{name}": surfaces} if surfaces else {}
        inputs = {name: {"image": model.image, "touch": model.touch} for name, model in models.items()}
        write_measured(job, protocol, figures, groups, inputs, self.attributes(job, protocol))
        facts = {Path(name).name: DataDirectory(job.data).folder(name).facts for name in job.models}
        if job.models:
            job.console.print(escape(f"`vt-pipeline report {shlex.quote(str(job.data))}` shows what was measured"))
        shutil.rmtree(job.folder / MEASURED, ignore_errors=True)
        return {"objects": len(protocol.objects), "left_out": len(protocol.objects.rows.left_out), "training": facts}


def write_measured(
    job: DatasetJob,
    protocol: Protocol,
    figures: Mapping[str, Figures],  # of the networks, by name
    groups: Mapping[str, Mapping[str, Any]],  # the other groups of the schema
    inputs: Mapping[str, Mapping[str, Any]],  # of the networks, by name
    extra_attributes: Mapping[str, Any],  # of the root beside the common ones
) -> None:
    """Measure the baselines by the protocol, and write all figures and their tables."""
    rows = protocol.objects.rows
    attributes = {
        "settings": job.settings.results(),
        "seed": job.seed,
        "split": rows.split,
        "configurations": inputs,
        "left_out": rows.left_out,
        "training_objects": len(protocol.training or ()),
        "paper_sizes": has_paper_sizes(job.data),
        **extra_attributes,
    }
    figures = {**figures, **protocol.baselines()}
    write_evaluation(job.folder, {**groups, "figures": long_table(figures)}, attributes)
    content = {**attributes, "tables": [table.as_json() for table in evaluation_tables(job.folder)]}
    (job.folder / METRICS).write_text(json.dumps(content, indent=2, sort_keys=True, allow_nan=False))


def _measured(name: str, model: Reconstructor, protocol: Protocol, job: DatasetJob) -> tuple[list[Figure], Arrays]:
    """Read a model's figures and surfaces from the row file of a killed run, or measure it and write them to one."""
    files = RowFiles(job.folder / MEASURED)
    if result := files.find(name, protocol.stage):
        arrays = files.load(result)
        rows = [Figure(*row) for row in zip(*(arrays.pop(key).tolist() for key in Figure._fields), strict=True)]
        return rows, {key.removeprefix("surface/"): array for key, array in arrays.items()}
    rows, surfaces = measure(name, model, protocol, job)
    figures = dict(zip(Figure._fields, map(np.array, zip(*rows, strict=True)), strict=True))
    files.save(Result(name=name, key=protocol.stage), figures | {f"surface/{key}": array for key, array in surfaces.items()})
    return rows, surfaces


class Evaluate(NetworkEvaluation):
    """Make the supplement's tables from trained models."""

    name = "evaluate"
    summary = "Every trained model on the test objects: the supplement's tables, beside its figures."
    settings_type: ClassVar[type[GraspMeasuringSettings]] = EvaluationSettings
    protocol = GraspProtocol

    def inputs(self, settings: EvaluationSettings) -> tuple[Artifact, ...]:
        """Name the artifacts that the models take, and the grasps, around whose touch sites every model is measured."""
        networks = [inputs_of(name) for name in settings.configurations]
        takes_image, takes_touch = any(network.image for network in networks), any(network.touch for network in networks)
        return (SURFACES, GRASPS, *([VISION] if takes_image else []), *([TOUCH, CHARTS] if takes_touch else []))

    def rows(self, settings: EvaluationSettings) -> dict[str, str]:
        """Name the model of each configuration."""
        return {name: model_name(name, settings.training_seed) for name in settings.configurations}

    def splits(self, settings: EvaluationSettings) -> tuple[str, ...]:
        """Name all: the models are measured on test objects only, but Table 1 counts all."""
        return SPLITS

    def writes(self, settings: EvaluationSettings) -> str:
        """Name the evaluation of a data directory; each training seed has its own."""
        return evaluation_name(settings.training_seed)

    def cost(self, settings: EvaluationSettings, objects: int) -> Cost:
        """Estimate at most 12 reconstructions per configuration of each test object, a fifth of all, of about 0.1 s and 15 kB each."""
        reconstructions = 12 * len(settings.configurations) * objects / 5
        return Cost(seconds=0.1 * reconstructions, kilobytes=15 * reconstructions)


class EvaluateSingleImage(NetworkEvaluation):
    """Make Table 4 from the trained model."""

    name = "evaluate-single-image"
    summary = "The single-image network on the test objects: Table 4, beside the published rows."
    settings_type = SingleImageEvaluationSettings
    protocol = SingleImageProtocol

    def inputs(self, settings: SingleImageEvaluationSettings) -> tuple[Artifact, ...]:
        """Name the objects' points and renderings."""
        return (SURFACES, RENDERINGS)

    def rows(self, settings: SingleImageEvaluationSettings) -> dict[str, str]:
        """Name the one model."""
        return {"single-image": model_name("single-image")}

    def splits(self, settings: SingleImageEvaluationSettings) -> tuple[str, ...]:
        """Name the split that is measured, and the one that baselines retrieve from."""
        return ("train", "test")

    def writes(self, settings: SingleImageEvaluationSettings) -> str:
        """Name the one evaluation of a data directory."""
        return "evaluation-single-image"

    def cost(self, settings: SingleImageEvaluationSettings, objects: int) -> Cost:
        """Estimate a fifth of the objects, 0.3 s per view."""
        return Cost(seconds=0.06 * settings.views * objects, kilobytes=0.1 * objects)

    def attributes(self, job: DatasetJob, protocol: Any) -> dict[str, Any]:
        """Return the manifest and the number of views, which Table 4 names."""
        return {"manifest": DataDirectory(job.data).folder(model_name("single-image")).manifest, "views": protocol.views}
