"""`train-gcn`: learn to deform a sphere of vision charts around the touch charts, from images and touches (supplement 3)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, cast

from pipeline.config.settings import defining, setting
from pipeline.engine.stage import Cost, Trade
from pipeline.kernels.charts.touch_chart import SIDE
from pipeline.kernels.geometry.mesh import mesh_edges
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS, SINGLE_IMAGE, NetworkConfig, Norm, Seams, TouchEdges
from pipeline.store.directory import DataDirectory
from pipeline.training.learner import Batch, ReconstructionLearner
from pipeline.training.settings import ReconstructionSettings, Schedule
from pipeline.training.training_stage import ReconstructionTraining

if TYPE_CHECKING:
    from torch import Tensor

    from pipeline.kernels.metrics.chamfer import SearchCloud
    from pipeline.models.observation import ChartBatch
    from pipeline.training.items import Items


class GcnSettings(ReconstructionSettings):
    """How vision charts learn to take the object's shape (supplement 3.1-3.4)."""

    configurations = CONFIGURATIONS

    configuration: str = defining("occluded-touch", f"which of the supplement's networks: {', '.join(CONFIGURATIONS)}")
    gcn_layers: int | None = setting(8, "for trainings of minutes on a CPU; null is the table's 15 to 25", ge=2, le=1000)
    gcn_features: int | None = setting(96, "likewise; null is the table's 200 or 250", ge=3, le=2**16)
    encoder_layers: Literal[12, 15, 18, 25] | None = setting(None, "the table's; 12, 15 or 18 of 3.4's grid")
    encoder_kernel: Literal[3, 5] = setting(
        5, "as released, padded by 1; the 3 of the tables gives the same sizes, and has learned less after as many epochs"
    )
    encoder_norm: Norm | None = setting(
        None, "what follows each convolution; null is the table's: batch, or instance for single images; group does not depend on the batch"
    )
    encoder_width: float = setting(0.5, "share of the tables' channels, likewise", gt=0, le=2)
    mixed: float = setting(1 / 3, "share of features averaged over neighbours; the cited work has 1/10 as well", ge=0, le=1)
    passes: int = setting(3, "times the charts are deformed, with the same weights", ge=1, le=100)
    seams: Seams = setting("tied", "vertices of neighbouring charts that coincide move as one: a closed surface; open: the supplement's")
    touch_edges: TouchEdges = setting("centres", "all: touch charts influence every vision vertex, but not the reverse")
    edge_weight: float = setting(
        0.05,
        "of the mean squared edge length of the vision charts beside the Chamfer distance, both in m² of objects scaled to 0.5 m: a third "
        "of the surplus area; the supplement has none",
        ge=0,
    )
    learning_rate: float = setting(6e-3, "two hundred times the supplement's, for trainings a hundred times shorter", gt=0, le=100)
    schedule: Schedule = setting(
        "cosine", "the rate rises over the first twentieth of all steps, then falls to 0 along half a cosine; the supplement's is constant"
    )
    gradient_limit: float | None = setting(
        5.0, "norm to which a longer gradient is shortened before each step: without it, trainings with other seeds differ much", gt=0
    )
    batch_size: int = setting(
        4, "four times the steps in the time that the supplement's 16 take, and a Chamfer distance a third smaller", ge=1
    )
    epochs: int = setting(30, "minutes on a CPU; the supplement has 260", ge=1)
    patience: int | None = setting(70, "the supplement's", ge=1)
    loss_points: int = setting(3000, "points sampled on the prediction and drawn from the object's for the loss", ge=1)


class SingleImageSettings(GcnSettings):
    """How vision charts learn the object's shape from one rendering (supplement 3.6): as `train-gcn`'s settings, except these."""

    configurations = {"single-image": SINGLE_IMAGE}  # noqa: RUF012

    configuration: Literal["single-image"] = defining("single-image", "the only network")
    encoder_layers: Literal[12, 15, 18, 25] | None = setting(None, "the table's 25; the others are for images of 256 pixels")
    encoder_linear: int | None = setting(None, "features that the pooled ones become; null is the table's 250", ge=1, le=2**16)
    learning_rate: float = setting(3e-3, "for trainings of minutes; the supplement has 1e-5, for three days", gt=0, le=100)
    batch_size: int = setting(4, "more steps in the time; the supplement has 64", ge=1)
    epochs: int = setting(30, "minutes on a CPU; the supplement has at most 40, of more objects and all views", ge=1)
    patience: int | None = setting(None, "the supplement names none", ge=1)
    training_seed: Literal[0] = defining(0, "there is one training")
    min_grasps: Literal[1] = setting(1, "one image")
    max_grasps: Literal[1] = setting(1, "one image")
    samples_per_object: int = setting(5, "views per object and epoch; drawn one by one, where they are fewer than all 24", ge=1)
    validation_items: int = setting(5, "views per validation object, the first ones", ge=1)


class GcnLearner(ReconstructionLearner):
    """Minimise the distance of the predicted surface to the object's (supplement 3.3), and the weighted length of the predicted edges."""

    seeded_as = "train-gcn"

    def __init__(self, network: Any, train: Items, valid: Items, settings: Any, seed: int) -> None:
        import torch

        super().__init__(network, train, valid, settings, seed)
        faces = network.charts.position[network.charts.faces]  # of the closed surface that vertices that coincide make together
        self._edges = torch.from_numpy(mesh_edges(faces)[0])

    def targets(self, items: Items, numbers: Sequence[int], *_: Any, validates: bool) -> list[SearchCloud]:
        return [items.target(item) for item in numbers]

    def loss(self, network: Any, batch: Batch) -> Tensor:
        """Compute the items' mean Chamfer distance and weighted length of edges; the supplement lacks the latter."""
        from pipeline.kernels.metrics.chamfer import edge_length

        inputs = self.stack(network, batch)
        deformed = network(**vars(inputs))
        total: Tensor = self._chamfer(deformed, inputs, batch).mean()
        if weight := TABLE_3_FACTOR * self.settings.edge_weight:
            total = total + weight * edge_length(self.network.merge_coinciding(deformed), self._edges).mean()
        return total

    def errors(self, network: Any, batch: Batch) -> Tensor:
        """Compute the Chamfer distance of each item, (B,)."""
        inputs = self.stack(network, batch)
        return self._chamfer(network(**vars(inputs)), inputs, batch)

    def _chamfer(self, deformed: Tensor, inputs: ChartBatch, batch: Batch) -> Tensor:
        """Compute (B,) Chamfer distances of `loss_points` points each way to all the object's, in Table 3's unit."""
        import torch

        from pipeline.kernels.metrics.chamfer import sample_surface, squared_distances
        from pipeline.models.reconstruction import assemble_surfaces

        distances, count = [], self.settings.loss_points
        surfaces = assemble_surfaces(self.network, deformed, inputs)
        for (vertices, faces), target, generator in zip(surfaces, batch.targets, batch.generators, strict=True):
            predicted = sample_surface(vertices, faces, count, generator)
            rows = torch.randperm(len(target.points), generator=generator)[:count]
            true = target.points[rows].to(predicted)
            surface = target.points.to(predicted) if predicted.is_cuda else target
            distances.append(squared_distances(predicted, surface).mean() + squared_distances(true, predicted).mean())
        return TABLE_3_FACTOR * torch.stack(distances)


class TrainGcn(ReconstructionTraining):
    """Train a network that deforms vision charts into the whole surface."""

    name = "train-gcn"
    summary = "Train the graph network that deforms vision charts, in one of the supplement's configurations."
    settings_type: ClassVar[type[GcnSettings]] = GcnSettings
    learner = GcnLearner
    arrays = ("points",)

    def grid(self, settings: GcnSettings) -> dict[str, tuple[Any, ...]]:
        """Give the grid of supplement 3.4; networks without an image have no encoder to vary."""
        encoders = {"encoder_layers": (12, 15, 18)} if settings.inputs.image else {}
        rates, layers, features = (1e-4, 3e-5, 1e-5), (15, 20, 25), (150, 200, 250)
        return {"learning_rate": rates, **encoders, "gcn_layers": layers, "gcn_features": features}

    def cost(self, settings: GcnSettings, objects: int) -> Cost:
        """Estimate about a second per item at the tables' sizes on one core, less in proportion to the network's."""
        network = cast(NetworkConfig, settings.network(SIDE))
        share = network.gcn_layers * network.gcn_features**2 / (20 * 250**2)
        items = objects * settings.samples_per_object * settings.epochs
        return Cost(seconds=items * (0.02 + 0.9 * share), kilobytes=8000 * share + 500)


class TrainSingleImage(TrainGcn):
    """Train the network of Table 11 as `train-gcn` trains the others, on renderings (supplement 3.6)."""

    name = "train-single-image"
    summary = "Train the graph network that deforms vision charts to the object of a single rendering."
    settings_type = SingleImageSettings

    def grid(self, settings: GcnSettings) -> dict[str, tuple[Any, ...]]:
        """Return an empty grid: the supplement searched none for this network."""
        return {}


def chamfer_distances(data: Path, reference: Path) -> dict[str, float]:
    """Read the Chamfer distances x 9000 of the evaluated network, mean over numbers of grasps, by test object."""
    from stages.evaluate.evaluation_files import chamfer_by_object, evaluation_name

    return chamfer_by_object(DataDirectory(data).verified_folder(evaluation_name()))


TRADE = Trade(
    metric="Chamfer distance x 9000 of test objects",
    unit="",
    candidates=({"epochs": 3}, {"epochs": 12}, {"gcn_features": 24}, {"loss_points": 500}),
    errors=chamfer_distances,
    evaluated_by="evaluate",
)
