"""Trained deformation networks: the vision charts of a sphere, moved around the touch charts."""

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.network_configurations import NetworkConfig
from pipeline.models.observation import NetworkBatch, Observation
from pipeline.models.reconstruction import Reconstruction, Reconstructor


class DeformationReconstructor(Reconstructor):
    """A trained deformation network, from its folder."""

    config_type = NetworkConfig
    network_type = DeformationNetwork
    has_charts = True
    network: DeformationNetwork

    def _surfaces(self, observations: Sequence[Observation]) -> list[Reconstruction]:
        batch = self._batch(observations)
        charts, deformed = self.network.charts, self.network(**vars(batch))
        return [
            Reconstruction(
                vertices=vertices.double().cpu().numpy(),
                faces=faces.cpu().numpy(),
                vision=len(charts.vertices),
                position=charts.position,
                side=self.network.config.side,
            )
            for vertices, faces in assemble_surfaces(self.network, deformed, batch)
        ]


def assemble_surfaces(
    network: DeformationNetwork,
    deformed: Tensor,  # (B, V, 3) vertices of the vision charts, world, m
    batch: NetworkBatch,  # gives the touch charts
) -> Iterator[tuple[Tensor, Tensor]]:  # (V, 3) vertices, world, m, and (F, 3) faces, of each item
    """Join the vision charts of each item and the charts of its successful touches."""
    vision_faces = torch.tensor(network.charts.faces, device=deformed.device)
    touch_faces = chart_square(network.config.side)[1].to(deformed.device)
    charts_of, touched_of = torch.split(batch.touch_vertices, batch.counts), torch.split(batch.touched, batch.counts)
    for vision, charts, touched in zip(deformed, charts_of, touched_of, strict=True):
        surface = charts[touched]  # (K, S, 3)
        first = len(vision) + torch.arange(len(surface), device=vision.device) * surface.shape[1]
        faces = (touch_faces + first[:, None, None]).reshape(-1, 3)
        yield torch.cat([vision, surface.reshape(-1, 3)]), torch.cat([vision_faces, faces])
