"""Trained models on the test objects: by the supplement's tables (2.4, 3.5), and single images by Table 4's standard (3.6)."""

import json
import shlex
import shutil
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field
from rich.markup import escape

from pipeline.config.settings import Settings, defining, setting
from pipeline.dataset.object_rows import has_paper_sizes
from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.errors import unknown_name
from pipeline.models.families import ROWS, load_rows, model_name, rows_of
from pipeline.store.atomic import flush
from pipeline.store.directory import DataDirectory
from pipeline.store.rows import Result, RowFiles
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.renderings import RENDERINGS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import METRICS, Figure, Figures, evaluation_name, long_table, write_evaluation

if TYPE_CHECKING:
    from stages.evaluate.measure import Method, Protocol

MEASURED = "measured"  # folder of the row files of finished networks, which a killed run leaves


def _with_one(grasps: tuple[int, ...]) -> tuple[int, ...]:
    if 1 not in grasps or len(set(grasps)) < len(grasps):
        raise ValueError(f"{grasps}: numbers must be unique and include 1, which two tables use")
    return tuple(sorted(grasps))


def _known(names: tuple[str, ...]) -> tuple[str, ...]:
    known = [name for name, row in ROWS.items() if row.inputs.image != "rendering"]
    if strange := [name for name in names if name not in known]:
        raise ValueError(unknown_name("configuration", strange[0], known))
    # a network that accepts any subset of inputs is evaluated with each
    rows = [row for name in names for row in rows_of(name)]
    if not rows or len(set(rows)) < len(rows):
        raise ValueError(f"{names}: name some of {', '.join(known)}, each once")
    return tuple(rows)


class MeasuringSettings(Settings):
    """The settings of a measurement of networks by any protocol."""

    points: int = setting(10_000, "points drawn from each surface: as many as S^obj has; the sampling floor falls with them", ge=2)
    tau: float = defining(1e-4, "squared distance of F1 in Table 4's protocol, in its scaled unit", gt=0, le=1e6)
    batch_size: int = setting(16, "as in training; more needs more memory, and sums may differ in their last bit with it", ge=1)
    threads: int = setting(1, "of torch on a CPU, as in training", ge=1)
    accelerator: Literal["auto", "cpu", "cuda"] = setting("auto", "a GPU where there is one", changes="speed")


class GraspMeasuringSettings(MeasuringSettings):
    """Choose what is measured of surfaces that were made from grasps (supplement 3.5, Tables 2 to 4)."""

    grasps: Annotated[tuple[Annotated[int, Field(ge=1)], ...], AfterValidator(_with_one)] = defining(
        (1, 2, 3, 4, 5), "Table 3's numbers of grasps; larger ones than the dataset's are skipped, and named"
    )
    scale: float = defining(
        1.14, "Table 4's protocol takes objects of diagonal 1 times 0.57; here their diagonal is 0.5 m, so tau means the same", gt=0, le=1e6
    )
    rings: int = defining(5, "Table 2's rings, one sensor width after the other", ge=1)
    closed_resolution: int | None = setting(
        None,
        "edges along the longest side of a closed mesh of each object's reconstruction with one grasp, for its watertightness and "
        "intersection over union; null measures those of networks that make closed meshes, as they are; docs/guide/learning.md has "
        "the times; fewer edges than 64 would swell thin bodies",
        ge=64,
        le=400,
    )


class EvaluationSettings(GraspMeasuringSettings):
    """Choose which networks are measured."""

    configurations: Annotated[tuple[str, ...], AfterValidator(_known)] = defining(
        ("none", "touch", "occluded", "occluded-touch", "unoccluded", "unoccluded-touch"),
        "the supplement's five modalities and no input at all; what none of them takes need not have been made",
    )
    training_seed: int = defining(0, "whose networks are evaluated: those of the trainings with this setting", ge=0)
    first_only: bool = setting(False, "only reconstructions that begin with an object's first grasp: a fifth of the time of five grasps")


class SingleImageEvaluationSettings(MeasuringSettings):
    """Table 4's standard, and how many views of each object are measured (supplement 3.6)."""

    views: int = defining(
        5, "views per test object, the first ones, and per training object of the baselines; the cited evaluations take all 24", ge=1
    )
    scale: float = defining(0.57, "what objects whose bounding box has diagonal 1 are multiplied by, the standard's", gt=0, le=1e6)


class Evaluation(DatasetStage):
    """Measure networks, or other methods, by a protocol."""

    keeps_surfaces: ClassVar[bool] = True

    def networks(self, settings: Any) -> dict[str, str]:
        """Name the model of each network that is measured, a row of the tables each; by default none."""
        return {}

    def first_only(self, settings: Any) -> bool:
        """Say whether only cases that begin with the first grasp are measured."""
        return False

    @abstractmethod
    def protocol(self, job: DatasetJob, methods: "Sequence[Method]") -> "Protocol":
        """Open the objects and choose what is measured of reconstructions."""

    def models(self, settings: Any) -> tuple[str, ...]:
        """Name the models, of which one may have several rows."""
        return tuple(dict.fromkeys(self.networks(settings).values()))

    def splits(self, settings: Any) -> tuple[str, ...]:
        """Name the split that is measured, and the one that baselines retrieve from."""
        return ("train", "test")

    def methods(self, job: DatasetJob) -> "Sequence[Method]":
        """Load what is measured."""
        from pipeline.models.device import device_of
        from stages.evaluate.measure import Network

        folders = {name: job.models[model] for name, model in self.networks(job.settings).items()}
        loaded = load_rows(folders, device_of(job.settings.accelerator))
        first_only = self.first_only(job.settings)
        return [Network(name, model, first_only=first_only, keeps_surfaces=self.keeps_surfaces) for name, model in loaded.items()]

    def attributes(self, job: DatasetJob, protocol: Any) -> dict[str, Any]:
        """Return further attributes of the evaluation's root; by default none."""
        return {}

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Measure one network or method after the other, then the baselines; write all figures and their means."""
        from pipeline.models.device import torch_threads

        methods = self.methods(job)
        protocol = self.protocol(job, methods)
        rows = protocol.objects
        figures: dict[str, Figures] = {}
        with torch_threads(job.settings.threads):
            for item in methods:
                figures[item.name] = Figures(rows.object_ids, _measured(item, protocol, job))
                for remark in item.remarks():
                    job.console.print(escape(remark))
        attributes = {
            "settings": job.settings.results(),
            "seed": job.seed,
            "split": rows.split,
            "configurations": {item.name: item.inputs for item in methods},
            "failed": rows.failed,
            "training_objects": len(protocol.training or ()),
            "paper_sizes": has_paper_sizes(job.data),
            **self.attributes(job, protocol),
        }
        figures |= protocol.baselines()
        write_evaluation(job.folder, {"objects": protocol.objects.table(), **protocol.extra(), "figures": long_table(figures)}, attributes)
        content = {**attributes, "means": {name: of_network.means() for name, of_network in figures.items()}}
        (job.folder / METRICS).write_text(json.dumps(content, indent=2, sort_keys=True, allow_nan=False))
        shutil.rmtree(job.folder / MEASURED, ignore_errors=True)
        training = {Path(name).name: DataDirectory(job.data).folder(name).facts for name in job.models}
        if training:
            job.console.print(escape(f"`vt-pipeline report {shlex.quote(str(job.data))}` shows what was measured"))
        return {"objects": len(rows), "failed": len(rows.failed), "training": training}


def _measured(item: "Method", protocol: "Protocol", job: DatasetJob) -> list[Figure]:
    """Read figures from the row file of a killed run, or measure them; write surfaces to the evaluation, then figures to a row file."""
    from stages.evaluate.measure import measure

    files = RowFiles(job.folder / MEASURED)
    if result := files.find(item.name, protocol.stage):
        return [Figure(*row) for row in zip(*map(np.ndarray.tolist, files.load(result).values()), strict=True)]
    rows, surfaces = measure(item, protocol, job)
    if surfaces:
        write_evaluation(job.folder, {f"{'predictions' if item.has_charts else 'meshes'}/{item.name}": surfaces}, {})
        flush([*job.folder.rglob("*"), job.folder])  # figures without surfaces would be taken for finished
    figures = dict(zip(Figure._fields, map(np.array, zip(*rows, strict=True)), strict=True))
    files.save(Result(name=item.name, key=protocol.stage), figures)
    return rows


def artifacts_of(configurations: Iterable[str]) -> list[Artifact]:
    """Name the artifacts that networks take."""
    networks = [ROWS[name].inputs for name in configurations]
    takes = ((VISION, "image"), (TOUCH, "touch"), (CHARTS, "takes_charts"))
    return [artifact for artifact, name in takes if any(getattr(network, name) for network in networks)]


class Evaluate(Evaluation):
    """Measure trained networks around the grasps of the test objects, for the supplement's tables."""

    name = "evaluate"
    summary = "Every trained model on the test objects: the supplement's tables, beside its figures."
    settings_type = EvaluationSettings

    def inputs(self, settings: EvaluationSettings) -> tuple[Artifact, ...]:
        """Name the artifacts that the networks take, and the grasps, around whose touch sites each is measured."""
        return (SURFACES, GRASPS, *artifacts_of(settings.configurations))

    def networks(self, settings: EvaluationSettings) -> dict[str, str]:
        return {name: model_name(name, settings.training_seed) for name in settings.configurations}

    def first_only(self, settings: EvaluationSettings) -> bool:
        return settings.first_only

    def writes(self, settings: EvaluationSettings) -> str:
        """Name the evaluation of a data directory; each training seed has its own."""
        return evaluation_name(settings.training_seed)

    def cost(self, settings: EvaluationSettings, objects: int) -> Cost:
        """Estimate 4 or 12 reconstructions per configuration of each test object, a fifth of all, of about 0.1 s and 15 kB each."""
        reconstructions = (4 if settings.first_only else 12) * len(settings.configurations) * objects / 5
        return Cost(seconds=0.1 * reconstructions, kilobytes=15 * reconstructions)

    def protocol(self, job: DatasetJob, methods: "Sequence[Method]") -> "Protocol":
        from stages.evaluate.protocols import GraspProtocol

        return GraspProtocol(job, methods)


class EvaluateSingleImage(Evaluation):
    """Make Table 4 from the trained model."""

    name = "evaluate-single-image"
    summary = "The single-image network on the test objects: Table 4, beside the published rows."
    settings_type = SingleImageEvaluationSettings
    keeps_surfaces = False

    def inputs(self, settings: SingleImageEvaluationSettings) -> tuple[Artifact, ...]:
        return (SURFACES, RENDERINGS)

    def networks(self, settings: SingleImageEvaluationSettings) -> dict[str, str]:
        return {"single-image": model_name("single-image")}

    def writes(self, settings: SingleImageEvaluationSettings) -> str:
        return "evaluation-single-image"

    def cost(self, settings: SingleImageEvaluationSettings, objects: int) -> Cost:
        """Estimate a fifth of the objects, 0.3 s per view."""
        return Cost(seconds=0.06 * settings.views * objects, kilobytes=0.1 * objects)

    def protocol(self, job: DatasetJob, methods: "Sequence[Method]") -> "Protocol":
        from stages.evaluate.protocols import SingleImageProtocol

        return SingleImageProtocol(job)

    def attributes(self, job: DatasetJob, protocol: Any) -> dict[str, Any]:
        """Return the manifest and the number of views, which Table 4 names."""
        return {"manifest": DataDirectory(job.data).folder(model_name("single-image")).manifest, "views": protocol.views}
