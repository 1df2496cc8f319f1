"""What trainings of networks that reconstruct objects have in common, whatever the family of the network."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple

import torch

from pipeline.engine.stage import DatasetJob, DatasetStage
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.image_encoder import ENCODER_PLANS
from pipeline.kernels.networks.implicit_network import ImplicitNetwork
from pipeline.models.model_files import save_model
from pipeline.models.observation import NetworkBatch, Observation, stack_observations
from pipeline.models.trained_networks import model_name
from pipeline.rng import torch_generator
from pipeline.training import checkpoint
from pipeline.training.augmentation import varied_observation
from pipeline.training.items import Items
from pipeline.training.learner import Learner
from pipeline.training.loop import train
from pipeline.training.settings import ReconstructionSettings
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.vision import VISION


class Materials(NamedTuple):
    """What a learner learns from: items of both splits, settings, and the root seed."""

    learning: Items
    judging: Items
    settings: Any
    seed: int


class ReconstructionLearner(Learner):
    """A network that reconstructs, with its items: what is read of them; a family adds its loss."""

    def __init__(self, network: DeformationNetwork | ImplicitNetwork, materials: Materials) -> None:
        super().__init__(network)
        self._train, self._valid, self._settings, self._seed = materials
        self._config, self._camera = network.config, self._train.camera
        asked: ReconstructionSettings = self._settings
        self._fewest, self._most = (min(count, self._train.grasps) for count in (asked.min_grasps, asked.max_grasps))

    def __len__(self) -> int:
        return len(self._train)

    def describe(self, item: int) -> str:
        """Name an item's object and first grasp."""
        return self._train.name(item)

    def observe(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> list[Observation]:
        """Read what the network is given of training items, each with as many grasps as are drawn for it, varied as the settings say."""
        drawn = [(self._train.drawn_view(item, self._fewest, self._most, one), one) for item, one in zip(items, generators, strict=True)]
        return [varied_observation(seen, self._settings, one) for seen, one in drawn]

    def observe_in_turn(self) -> Iterator[tuple[range, list[Observation]]]:
        """Read what the network is given of validation items, with 1, 2, … grasps in turn: batch by batch, with the items' numbers."""
        size = self._settings.batch_size
        for start in range(0, len(self._valid), size):
            chosen = range(len(self._valid))[start : start + size]
            yield chosen, [self._valid.view_in_turn(item, self._fewest, self._most) for item in chosen]

    def stack(self, observations: Sequence[Observation]) -> NetworkBatch:
        """Stack observations as the network takes them, on its device."""
        return stack_observations(observations, self._config, self._camera, like=next(self.module.parameters()))


class ReconstructionTraining(DatasetStage):
    """Trains a network of one configuration; a family says what it learns from, and how.

    Attributes
    ----------
    target
        The artifact whose arrays `learned` the loss needs.
    """

    trains = True
    target: ClassVar[Artifact]
    learned: ClassVar[tuple[str, ...]]

    def inputs(self, settings: Any) -> tuple[Artifact, ...]:
        """Name what is read: the target, and what the configuration sees and feels."""
        named = settings.named
        return (self.target, *([VISION] if named.image else []), *([CHARTS] if named.touch else []))

    def splits(self, settings: Any) -> tuple[str, ...]:
        """Name the splits: one to learn from, one to choose the best epoch by."""
        return ("train", "valid")

    def writes(self, settings: Any) -> str:
        """Name the folder of the configuration's model, below the data directory."""
        return model_name(settings.configuration, settings.training_seed)

    @abstractmethod
    def network(self, settings: Any, side: int, generator: torch.Generator) -> DeformationNetwork | ImplicitNetwork:
        """Make the network, for touch charts of side x side vertices; the generator draws its weights."""

    @abstractmethod
    def learner(self, network: Any, materials: Materials) -> ReconstructionLearner:
        """Make what trains the network."""

    def remarks(self, network: Any, items: Items) -> Iterator[str]:
        """Say what of the items a network is not made for, though it learns from them."""
        made_for = ENCODER_PLANS[network.config.encoder_layers].resolution
        if network.config.image and items.resolution != [made_for, made_for]:
            yield f"images are of {items.resolution} pixels, the encoder's table is for {made_for}: see render-vision.resolution"

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Train, and keep the best epoch's weights with what it takes to use them."""
        settings = job.settings
        splits = (("train", settings.items), ("valid", settings.validation_items))
        learning, judging = (Items(job.data, split, settings.named, each, learned=self.learned) for split, each in splits)
        name = f"{self.name} {settings.configuration}{settings.label}"
        network = self.network(settings, learning.side, torch_generator(job.seed, name, "weights"))
        for line in self.remarks(network, learning):
            job.console.print(f"{name}: {line}")
        learner = self.learner(network, Materials(learning, judging, settings, job.seed))
        facts = train(learner, settings, folder=job.folder, seed=job.seed, name=name)
        save_model(job.folder, network, learning.description(settings.configuration, network.config))
        checkpoint.discard(job.folder)
        return facts
