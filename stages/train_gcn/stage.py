"""Supplement 3: learn to deform a sphere of vision charts around the touch charts, from what is seen and felt."""

from __future__ import annotations

from typing import Any

from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.kernels.charts.touch_chart import SIDE
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.image_encoder import ENCODER_PLANS
from pipeline.models.model_files import save_model
from pipeline.models.trained_networks import model_name
from pipeline.rng import torch_generator
from pipeline.training import checkpoint
from pipeline.training.loop import train
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.surfaces import SURFACES
from schemas.vision import VISION
from stages.train_gcn.items import Items
from stages.train_gcn.learner import GcnLearner
from stages.train_gcn.settings import GcnSettings


class TrainGcn(DatasetStage):
    """Trains a network that deforms vision charts to the whole surface."""

    name = "train-gcn"
    summary = "Train the graph network that deforms vision charts, in one of the supplement's configurations."
    settings_type = GcnSettings
    trains = True

    def inputs(self, settings: GcnSettings) -> tuple[Artifact, ...]:
        """Name what is read: the objects' points, and what the configuration sees and feels."""
        named = settings.named
        return (SURFACES, *([VISION] if named.image else []), *([CHARTS] if named.touch else []))

    def splits(self, settings: GcnSettings) -> tuple[str, ...]:
        """Name the splits: one to learn from, one to choose the best epoch by."""
        return ("train", "valid")

    def writes(self, settings: GcnSettings) -> str:
        """Name the folder of the configuration's model, below the data directory."""
        return model_name(settings.configuration, settings.training_seed)

    def grid(self, settings: GcnSettings) -> dict[str, tuple[Any, ...]]:
        """Give the grid of supplement 3.4; without an image there is no encoder to vary."""
        encoders = {"encoder_layers": (12, 15, 18)} if settings.named.image else {}
        rates, layers, features = (1e-4, 3e-5, 1e-5), (15, 20, 25), (150, 200, 250)
        return {"learning_rate": rates, **encoders, "gcn_layers": layers, "gcn_features": features}

    def cost(self, settings: GcnSettings, objects: int) -> Cost:
        """Estimate about a second per item at the tables' sizes on one core, less in proportion to the network's."""
        network = settings.network(SIDE)
        share = network.gcn_layers * network.gcn_features**2 / (20 * 250**2)
        return Cost(seconds=objects * settings.items * settings.epochs * (0.02 + 0.9 * share), kilobytes=8000 * share + 500)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Train, and keep the best epoch's weights with what it takes to use them."""
        settings: GcnSettings = job.settings
        splits = (("train", settings.items), ("valid", settings.validation_items))
        learning, judging = (Items(job.data, split, settings.named, each) for split, each in splits)
        config = settings.network(learning.side)
        name = f"{self.name} {settings.configuration}{settings.label}"
        made_for = ENCODER_PLANS[config.encoder_layers].resolution
        if config.image and learning.resolution != [made_for, made_for]:
            pixels = f"{learning.resolution} pixels, the encoder's table is for {made_for}"
            job.console.print(f"{name}: images are of {pixels}: see render-vision.resolution")
        network = DeformationNetwork(config, torch_generator(job.seed, name, "weights"))
        facts = train(GcnLearner(network, learning, judging, settings, job.seed), settings, folder=job.folder, seed=job.seed, name=name)
        save_model(job.folder, network, learning.description(settings.configuration, config))
        checkpoint.discard(job.folder)
        return facts
