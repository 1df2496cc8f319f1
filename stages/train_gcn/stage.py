"""Supplement 3: learn to deform a sphere of vision charts around the touch charts, from images and touches."""

from collections.abc import Sequence
from typing import Any, ClassVar, cast

import torch
from torch import Tensor

from pipeline.engine.stage import Cost
from pipeline.kernels.charts.touch_chart import SIDE
from pipeline.kernels.geometry.mesh import mesh_edges
from pipeline.kernels.metrics.chamfer import SearchCloud, squared_distances
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.metrics.surface_sampling import edge_length, sample_surface
from pipeline.kernels.networks.network_configurations import NetworkConfig
from pipeline.models.deformation_reconstruction import DeformationReconstructor, SingleImageReconstructor, assemble_surfaces
from pipeline.models.observation import NetworkBatch
from pipeline.training.items import Items
from pipeline.training.reconstruction import Batch, ReconstructionLearner, ReconstructionTraining
from schemas.surfaces import SURFACES
from stages.train_gcn.settings import GcnSettings, SingleImageSettings


class GcnLearner(ReconstructionLearner):
    """Minimise the distance of the predicted surface to the object's (supplement 3.3), and the weighted length of the predicted edges."""

    target, arrays, seeded_as = SURFACES, ("points",), "train-gcn"

    def __init__(self, network: Any, train: Items, valid: Items, settings: GcnSettings, seed: int) -> None:
        super().__init__(network, train, valid, settings, seed)
        faces = network.charts.position[network.charts.faces]  # of the closed surface that vertices that coincide make together
        self._edges = torch.from_numpy(mesh_edges(faces)[0])

    def targets(self, items: Items, numbers: Sequence[int], generators: Sequence[torch.Generator], *, validates: bool) -> list[SearchCloud]:
        """Read the points of each item's object."""
        return [items.target(item) for item in numbers]

    def loss(self, network: Any, batch: Batch) -> Tensor:
        """Compute the items' mean Chamfer distance and weighted length of edges; the supplement lacks the latter."""
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

    def _chamfer(self, deformed: Tensor, inputs: NetworkBatch, batch: Batch) -> Tensor:
        """Compute (B,) Chamfer distances of `loss_points` points each way to all the object's, in Table 3's unit."""
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
    family: ClassVar[type[DeformationReconstructor]] = DeformationReconstructor
    learner = GcnLearner

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
    family = SingleImageReconstructor

    def grid(self, settings: GcnSettings) -> dict[str, tuple[Any, ...]]:
        """Return an empty grid: the supplement searched none for this network."""
        return {}
