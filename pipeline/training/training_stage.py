"""Stages that train networks; those that train one that reconstructs objects have all but its targets and its loss here."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pipeline.console import pluralise
from pipeline.engine.stage import DatasetJob, DatasetStage
from pipeline.errors import StageError
from pipeline.kernels.networks.network_configurations import NetworkInputs
from pipeline.models.families import model_name, reconstructor_type, trained_folder, trained_models
from pipeline.rng import torch_generator
from pipeline.store.directory import DataDirectory
from pipeline.store.record import FolderRecord
from pipeline.training.learner import ReconstructionLearner
from pipeline.training.settings import ReconstructionSettings
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.renderings import RENDERINGS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION

if TYPE_CHECKING:
    from pipeline.training.items import Items

IMAGES = {"occluded": VISION, "unoccluded": VISION, "any": VISION, "rendering": RENDERINGS}
"""The artifact that holds each kind of image."""
LEARNED_BEFORE = "learned_before"  # name of a training's fact: what its pretrained network had learned from
OF_MESHES = ("spacing", "touch_reach")
"""Entries of a network's description that only decide how its predictions are meshed; its weights do not depend on them."""
OTHER_STAGES = {"side": "fit-charts"}
"""Stages that set entries of a network's description, by entry; its training sets the others."""


def touch_artifacts(inputs: NetworkInputs) -> tuple[Artifact, ...]:
    """Name the artifacts of the touches that a network takes."""
    return () if not inputs.touch else (CHARTS,) if inputs.takes_charts else (GRASPS, TOUCH)


class Training(DatasetStage):
    """A stage that trains a network."""

    trains = True

    def splits(self, settings: Any) -> tuple[str, ...]:
        """Name the splits: one to learn from, one to choose the best epoch by."""
        return ("train", "valid")


class ReconstructionTraining(Training):
    """Train a network of one configuration."""

    learner: ClassVar[type[ReconstructionLearner]]  # it has the loss
    target: ClassVar[Artifact] = SURFACES  # holds the targets
    arrays: ClassVar[tuple[str, ...]]  # those of `target` that are read

    def inputs(self, settings: Any) -> tuple[Artifact, ...]:
        """Name the artifacts of the objects' sizes and the target, and of the image and touches that the configuration takes."""
        inputs = settings.inputs
        target = [] if self.target is SURFACES else [self.target]
        return (SURFACES, *target, *([IMAGES[inputs.image]] if inputs.image else []), *touch_artifacts(inputs))

    def assets(self, settings: Any) -> list[Path]:
        """List the files of the network that the training begins with."""
        if settings.pretrained is None:
            return []
        from pipeline.models.model_files import DESCRIPTION, WEIGHTS
        from pipeline.models.shipped_weights import models_location

        folder = trained_folder(models_location(settings.pretrained), settings.configuration)
        return [folder / file for file in (DESCRIPTION, WEIGHTS)]

    def writes(self, settings: Any) -> str:
        """Name the folder of the configuration's model, below the data directory."""
        return model_name(settings.configuration, settings.training_seed)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Train, and save the best epoch's weights with the description of the model."""
        from pipeline.models.model_files import save_model
        from pipeline.training.items import Items
        from pipeline.training.loop import train

        settings = job.settings
        shared = {"learned": self.arrays, "cache_megabytes": settings.cache_megabytes}
        learning = Items(job.data, "train", settings.inputs, settings.samples_per_object, **shared)
        validation = Items(job.data, "valid", settings.inputs, settings.validation_items, **shared)
        name = f"{self.name} {settings.configuration}"  # seeds all draws
        name += f", seed {settings.training_seed}" if settings.training_seed else ""
        config = settings.network(learning.side)
        network: Any = reconstructor_type(settings.configuration).network_type(config, torch_generator(job.seed, name, "weights"))
        before = self._begin_with_pretrained(network, job, name) if settings.pretrained else None
        for line in remarks(settings, learning):
            job.console.print(f"{name}: {line}")
        learner = self.learner(network, learning, validation, settings, job.seed)
        facts = train(learner, settings, folder=job.folder, seed=job.seed, name=name)
        save_model(job.folder, network, learning.trained(settings.configuration, network.config))
        return facts | ({LEARNED_BEFORE: before} if before else {})

    def _begin_with_pretrained(self, network: Any, job: DatasetJob, name: str) -> list[dict[str, Any]]:
        """Give a network the weights of a trained one; return the training data of that one."""
        from pipeline.models.shipped_weights import models_location

        models, trained = models_location(job.settings.pretrained), job.settings.configuration
        folder = trained_folder(models, trained)
        if folder.resolve().parent == Path(str(job.data / job.name)).resolve().parent:
            raise StageError(
                f"pretrained={job.settings.pretrained}: this training would replace the network that it begins with; train with another "
                "training_seed, or name a copy of these models"
            )
        pretrained = reconstructor_type(trained)(folder)
        differing = [(name, value) for name, value in pretrained.config if name not in OF_MESHES and value != getattr(network.config, name)]
        if differing:
            stated = " ".join(f"{OTHER_STAGES.get(name, self.name)}.{name}={value}" for name, value in differing)
            raise StageError(f"the network in `pretrained` has other sizes; to begin with it, set {stated}")
        network.load_state_dict(pretrained.network.state_dict())
        before = learned_from(DataDirectory(trained_models(models)[trained]).folder(trained))
        names = ", ".join(dict.fromkeys(str(training["manifest"]) for training in before))
        job.console.print(f"{name} begins with weights that have learned from objects of {names}: test objects among these are not unseen")
        return before


def remarks(settings: ReconstructionSettings, items: "Items") -> Iterator[str]:
    """Report settings that differ from their defaults without effect on this network, and items that it is not designed for."""
    from pipeline.kernels.networks.image_encoder import ENCODER_PLANS

    inputs, fields = settings.inputs, type(settings).model_fields
    uses: dict[str, object] = {name: inputs.image for name in ("image_", "encoder_")}
    uses |= {name: inputs.touch for name in ("touch_reach", "touch_edges", "dropped_touches", "near_touches", "min_grasps", "max_grasps")}
    uses |= {"dropped_image": inputs.image == "any", "dropped_grasps": inputs.image == "any"}
    uses |= {"placement_error": inputs.image and inputs.touch}
    for name, field in fields.items():
        if any(name.startswith(start) and not used for start, used in uses.items()) and getattr(settings, name) != field.default:
            yield f"{name}={getattr(settings, name)} has no effect: this network is not given what it changes"
    made_for = ENCODER_PLANS[settings.network(items.side).encoder_layers].resolution
    if items.resolution and items.resolution != (made_for, made_for):
        size = list(items.resolution)
        yield f"images are of {size} pixels, the encoder's table is for {made_for}: see render-vision.resolution"
    if inputs.touch and settings.max_grasps > items.grasps:
        yield (
            f"items have at most {pluralise(items.grasps, 'grasp')}, min_grasps is {settings.min_grasps} and max_grasps "
            f"{settings.max_grasps}: the dataset holds no more of an object (simulate-grasps.grasps)"
        )


def learned_from(record: FolderRecord) -> list[dict[str, Any]]:
    """List the training data of a record's network, also from before its training: manifest and items of each training."""
    manifest = record.options.get("--manifest", record.manifest)
    return [*record.facts.get(LEARNED_BEFORE, []), {"manifest": manifest, "items": record.facts["items"]}]
