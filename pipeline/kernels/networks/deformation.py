"""The network that deforms vision charts around touch charts: image encoder, perceptual pooling, graph network (Tables 6-11)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

from pipeline.kernels.charts.chart_sphere import chart_sphere
from pipeline.kernels.metrics.precision import check_full
from pipeline.kernels.networks.configurations import NetworkConfig
from pipeline.kernels.networks.encoder import ENCODER_PLANS, ImageEncoder
from pipeline.kernels.networks.graph import ChartGraph, batch_graph
from pipeline.kernels.networks.graph_network import GraphNetwork
from pipeline.kernels.networks.images import COLOURS
from pipeline.kernels.networks.pooling import pool, see

VISION, TOUCHED, FAILED = 0.0, 1.0, -1.0
"""Mask feature of a vertex: of a vision chart, of a touch chart that touched, of one that did not."""
ITEMS_ON_CPU = 4
"""Items that the graph network works on at once: fewer, and the allocator keeps a fifth more memory; more, and caches hold no layer."""
FIRST_STEP = 0.1
"""Scale of the last layer's initial weights: the first displacements are small against the sphere's radius."""


class DeformationNetwork(nn.Module):
    """Moves a sphere of vision charts so that, with the touch charts, it becomes the object's surface.

    The vertices are moved `config.passes` times by one graph network. It sees for each vertex its position in units of the sphere's
    radius from the sphere's centre, which keeps features and displacements near 1, what kind of vertex it is (with touch), and the image
    features at its place (with an image); these are pooled anew in each pass while the image encoder runs once. What comes out is
    added to the positions of vision vertices, in the same units. Touch charts never move.

    Parameters
    ----------
    config
        Inputs and sizes.
    generator
        Draws the initial weights: equal generators give equal networks. Torch's own if None.
    """

    def __init__(self, config: NetworkConfig, generator: torch.Generator | None = None):
        super().__init__()
        self.config = config
        self.sphere = chart_sphere(config.splits)
        self.encoder: ImageEncoder | None = None
        self.linear: nn.Linear | None = None
        pooled = 0
        with torch.random.fork_rng(devices=[]):  # layers draw weights from torch's own generator when made; these are drawn anew below
            if config.image is not None:
                plan = ENCODER_PLANS[config.encoder_layers]
                self.encoder = ImageEncoder(plan, config.encoder_kernel, config.encoder_norm, config.encoder_width)
                pooled = self.encoder.channels
                if config.encoder_linear is not None:
                    self.linear = nn.Linear(pooled, config.encoder_linear)
                    pooled = config.encoder_linear
            self.gcn = GraphNetwork(3 + config.touch + pooled, config.gcn_layers, config.gcn_features, config.mixed)
        initialise(self, generator)

    def forward(
        self, images: Tensor | None, camera: Tensor | None, touch_vertices: Tensor | None, touched: Tensor | None, counts: Sequence[int]
    ) -> Tensor:
        """Vision vertices of a batch of B items: (B, V, 3), world, m.

        Parameters
        ----------
        images
            (B, 3, H, W) in [0, 1]; None for a network without image.
        camera
            (3, 4) projection matrix of world points to pixels of these images, or one for each item, (B, 3, 4); None without image.
        touch_vertices
            (T, S, 3) the touch charts of all items, one after the other: S = side · side vertices each, world, m. None for a network
            without touch; T may be 0.
        touched
            (T,) bool, which of them touched.
        counts
            Touch charts of each item, B numbers that sum to T.

        Notes
        -----
        In evaluation on a CPU, with initial weights, float32 places vertices within 1 µm of where float64 does, and bfloat16 under
        autocast within 10 mm; with instance normalisation, which magnifies rounding, within 10 µm and 50 mm.

        Raises
        ------
        ValueError
            Where an input is missing, one too many, of the wrong shape or not finite, or the parameters are of half precision
            (under autocast the layers may be).
        """
        self._check(images, camera, touch_vertices, touched, counts)
        start = torch.tensor(self.sphere.vertices).to(self.gcn.last.weight)  # (V, 3) on the parameters' device, in their precision
        graphs = self._graphs(counts, start)
        maps = [] if images is None or self.encoder is None else self.encoder(images.to(start.dtype))
        camera = None if camera is None else camera.to(start)
        touch_features = start.new_zeros((0, self.gcn.in_features))
        if touch_vertices is not None and touched is not None and len(touched):
            touch_features = self._touch_features(touch_vertices.to(start), touched, counts, maps, camera)
        positions = start.expand(len(counts), -1, -1)  # (B, V, 3) in radii from the centre
        for _ in range(self.config.passes):
            if self.config.checkpointing and torch.is_grad_enabled():
                step: Tensor = checkpoint(
                    self._step, positions, touch_features, maps, camera, graphs, use_reentrant=False, preserve_rng_state=False
                )
            else:
                step = self._step(positions, touch_features, maps, camera, graphs)
            positions = positions + step
        return self._placed(positions)

    def _graphs(self, counts: Sequence[int], like: Tensor) -> list[ChartGraph]:
        """The batch's graph, cut into the parts that the graph network works on at once, on the device and in the precision of `like`."""
        together = self.config.items_at_once or (ITEMS_ON_CPU if like.device.type == "cpu" else len(counts))
        parts = [tuple(counts[first : first + together]) for first in range(0, len(counts), together)]
        graphs = {part: batch_graph(self.sphere, self.config.side, part, like.device, like.dtype) for part in set(parts)}
        return [graphs[part] for part in parts]

    def _step(
        self, positions: Tensor, touch_features: Tensor, maps: list[Tensor], camera: Tensor | None, graphs: list[ChartGraph]
    ) -> Tensor:
        """(B, V, 3) what one pass adds to the vision vertices' positions, radii."""
        kind = positions.new_full((*positions.shape[:2], 1), VISION) if self.config.touch else None
        vision_features = self._features(positions, kind, maps, camera)
        vision_parts = torch.split(vision_features, [len(graph.counts) for graph in graphs])
        touch_parts = torch.split(touch_features, [sum(graph.counts) * self.config.side**2 for graph in graphs])
        parts = zip(graphs, vision_parts, touch_parts, strict=True)
        return torch.cat([self.gcn.of_vision(graph.join(vision, touch), graph) for graph, vision, touch in parts])

    def _features(self, positions: Tensor, kind: Tensor | None, maps: list[Tensor], camera: Tensor | None) -> Tensor:
        """(B, N, F) features of vertices at positions (B, N, 3), radii from the centre."""
        features = [positions] if kind is None else [positions, kind]
        if camera is not None and self.encoder is not None:
            pooled = pool(maps, self.encoder.grids, see(camera, self._placed(positions)))
            features.append(pooled if self.linear is None else self.linear(pooled).relu())
        return torch.cat(features, dim=-1)

    def _placed(self, positions: Tensor) -> Tensor:
        """World, m, from radii from the centre."""
        return positions * self.config.radius + positions.new_tensor(self.config.centre)

    def _touch_features(
        self, vertices: Tensor, touched: Tensor, counts: Sequence[int], maps: list[Tensor], camera: Tensor | None
    ) -> Tensor:
        """(T · S, F) features of the touch vertices, which hold for every pass since they never move."""
        given = torch.arange(max(counts), device=vertices.device) < torch.tensor(counts, device=vertices.device)[:, None]  # (B, most)
        positions = vertices.new_zeros((*given.shape, *vertices.shape[1:]))  # (B, most, S, 3)
        positions[given] = (vertices - vertices.new_tensor(self.config.centre)) / self.config.radius
        kind = vertices.new_full(positions.shape[:3], FAILED)
        kind[given] = torch.where(touched, TOUCHED, FAILED).to(vertices.dtype)[:, None].expand(vertices.shape[:2])
        features = self._features(positions.flatten(1, 2), kind.flatten(1, 2)[..., None], maps, camera)
        return features.reshape(*positions.shape[:3], -1)[given].flatten(0, 1)

    def _check(
        self, images: Tensor | None, camera: Tensor | None, touch_vertices: Tensor | None, touched: Tensor | None, counts: Sequence[int]
    ) -> None:
        check_full("a network with parameters", self.gcn.last.weight)
        if not counts:
            raise ValueError("counts is empty, but a batch needs one item at least")
        wanted = self.config.image is not None
        if (images is not None) != wanted or (camera is not None) != wanted:
            raise ValueError(
                f"a network with image {self.config.image!r} takes {'an image and its camera' if wanted else 'neither image nor camera'}"
            )
        if images is not None and (images.ndim != 4 or images.shape[:2] != (len(counts), COLOURS)):
            raise ValueError(
                f"images are {tuple(images.shape)}, but counts has {len(counts)} items: images must be ({len(counts)}, {COLOURS}, H, W)"
            )
        if not self.config.touch and (touch_vertices is not None or touched is not None or any(counts)):
            raise ValueError(f"a network without touch takes no touch charts, but counts is {list(counts)}: leave them out, with counts 0")
        if self.config.touch:
            if touch_vertices is None or touched is None:
                raise ValueError(
                    "a network with touch takes touch_vertices and touched; with no charts they are of shape (0, S, 3) and (0,)"
                )
            total, size = sum(counts), self.config.side**2
            if tuple(touch_vertices.shape) != (total, size, 3) or tuple(touched.shape) != (total,) or touched.dtype != torch.bool:
                raise ValueError(
                    f"touch_vertices are {tuple(touch_vertices.shape)} and touched {tuple(touched.shape)} {touched.dtype}, "
                    f"but counts sum to {total}: they must be ({total}, {size}, 3) and ({total},) bool"
                )
        for name, values in (("images", images), ("camera", camera), ("touch_vertices", touch_vertices)):
            if values is not None and not bool(torch.isfinite(values).all()):
                raise ValueError(f"{name} has values that are not finite: leave out the items they come from")


def initialise(network: DeformationNetwork, generator: torch.Generator | None) -> None:
    """Draw every weight anew: He's normal weights, which keep the features' size through 25 layers of ReLU, and biases zero."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.kaiming_normal_(module.weight, nonlinearity="relu", generator=generator)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
    with torch.no_grad():
        network.gcn.last.weight.mul_(FIRST_STEP)
