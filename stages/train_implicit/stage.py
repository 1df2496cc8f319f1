"""`train-implicit`: learn the signed distance from any point in space to the object, from what is seen and felt."""

from __future__ import annotations

from typing import Any

from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.kernels.networks.implicit_network import ImplicitNetwork
from pipeline.models.model_files import save_model
from pipeline.models.trained_networks import model_name
from pipeline.rng import torch_generator
from pipeline.training import checkpoint
from pipeline.training.loop import train
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.distances import DISTANCES
from schemas.vision import VISION
from stages.train_gcn.items import Items
from stages.train_implicit.learner import LEARNED, ImplicitLearner
from stages.train_implicit.settings import ImplicitSettings


class TrainImplicit(DatasetStage):
    """Trains a network that predicts signed distances, from which marching cubes make a closed surface."""

    name = "train-implicit"
    summary = "Train an implicit network: signed distances at any point, from an image or touches or both."
    settings_type = ImplicitSettings
    trains = True

    def inputs(self, settings: ImplicitSettings) -> tuple[Artifact, ...]:
        """Name what is read: distances, and what the configuration sees and feels."""
        named = settings.named
        return (DISTANCES, *([VISION] if named.image else []), *([CHARTS] if named.touch else []))

    def splits(self, settings: ImplicitSettings) -> tuple[str, ...]:
        """Name the splits: one to learn from, one to choose the best epoch by."""
        return ("train", "valid")

    def writes(self, settings: ImplicitSettings) -> str:
        """Name the folder of the configuration's model, below the data directory."""
        return model_name(settings.configuration, settings.training_seed)

    def cost(self, settings: ImplicitSettings, objects: int) -> Cost:
        """Estimate what an item takes on one core, in proportion to its points and the squared features."""
        each = 0.01 + 0.02 * settings.queries / 500 * (settings.features / 128) ** 2
        return Cost(seconds=objects * settings.items * settings.epochs * each, kilobytes=3000)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Train, and keep the best epoch's weights with what it takes to use them."""
        settings: ImplicitSettings = job.settings
        splits = (("train", settings.items), ("valid", settings.validation_items))
        learning, judging = (Items(job.data, split, settings.named, each, learned=LEARNED) for split, each in splits)
        config = settings.network(learning.side)
        name = f"{self.name} {settings.configuration}{settings.label}"
        network = ImplicitNetwork(config, torch_generator(job.seed, name, "weights"))
        learner = ImplicitLearner(network, learning, judging, settings, job.seed)
        facts = train(learner, settings, folder=job.folder, seed=job.seed, name=name)
        save_model(job.folder, network, learning.description(settings.configuration, config))
        checkpoint.discard(job.folder)
        return facts
