"""The families of trained networks: vision charts that are deformed around touch charts, and signed distances that are meshed."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.geometry.level_set import level_set_mesh
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.implicit_network import Encoding, ImplicitNetwork
from pipeline.kernels.networks.network_configurations import ImplicitConfig, NetworkConfig
from pipeline.models.observation import NetworkBatch, Observation
from pipeline.models.reconstruction import Reconstruction, Reconstructor

QUERIES = 2**12
"""Points whose distances are predicted at a time: their features stay in a processor's cache, a fifth faster than eight times as many."""
MARGIN = 1.04
"""Half the side of the meshed cube, in radii: beyond any object that was scaled to 0.5 m."""
HALVINGS = 3
"""Times that the spacing of the first predictions is halved, where the surface may be."""


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


class ImplicitReconstructor(Reconstructor):
    """A trained implicit network, from its folder."""

    config_type = ImplicitConfig
    network_type = ImplicitNetwork
    network: ImplicitNetwork

    def _surfaces(self, observations: Sequence[Observation]) -> list[Reconstruction]:
        reconstructions = []
        for observation in observations:
            code = self.network.encode(**vars(self._batch([observation])))
            vertices, faces, is_guess = self._mesh(code)
            position = np.arange(len(vertices))
            reconstructions.append(Reconstruction(vertices, faces, len(vertices), position, self.config.side, is_guess))
        return reconstructions

    def _mesh(self, code: Encoding) -> tuple[NDArray[np.float64], NDArray[np.int64], bool]:
        """Mesh the zeros of one item's distances: vertices (V, 3), m, faces (F, 3), and whether they are a guess.

        They are if no point is inside: then this is a level set around the smallest distance. Without an image, only
        the largest piece and touched ones are kept: the others are guesses that exclude each other.
        """
        errors = self.network.errors_at_touches(code)

        def distances(points: NDArray[np.float64]) -> NDArray[np.float64]:
            queries = torch.from_numpy(points).to(code.overall)
            blocks = [self.network.decode_with_touches(code, block[None], errors)[0] for block in torch.split(queries, QUERIES)]
            return np.asarray(torch.cat(blocks).double().cpu().numpy())

        config = self.network.config
        centre, reach, spacing = np.array(config.centre), MARGIN * config.radius, config.spacing
        box = centre - reach, centre + reach
        vertices, faces = level_set_mesh(
            distances,
            *box,
            spacing,
            halvings=HALVINGS,
            dense_points=self.network.touched_points(code),
            dense_radius=config.touch_reach,
            loose_pieces=len(code.with_image) > 0,
        )
        if len(faces):
            return vertices, faces, False
        coarse = 4 * spacing  # this surface is a guess, and needs no detail
        grid = np.stack(np.meshgrid(*(np.arange(low, high, coarse) for low, high in zip(*box, strict=True)), indexing="ij"), axis=-1)
        lowest = distances(grid.reshape(-1, 3)).min() + 1e-6  # a micrometre: the same points may be rounded differently in other batches
        return *level_set_mesh(lambda points: distances(points) - lowest, *box, coarse, halvings=0), True
