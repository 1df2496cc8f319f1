"""The network that deforms vision charts around touch charts: image encoder, perceptual pooling, graph network (Tables 6-11)."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from pipeline.errors import InvalidInput
from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.networks.chart_graph import GraphConvolutionNetwork, chart_graph
from pipeline.kernels.networks.image_encoder import ENCODER_PLANS, ImageEncoder, pool_features, project_to_pixels
from pipeline.kernels.networks.network_configurations import NetworkConfig
from pipeline.kernels.tensors import draw_weights

VISION, TOUCHED, NOT_TOUCHED = 0.0, 1.0, -1.0  # mask feature: vision chart, chart of a successful touch, other touch chart
INITIAL_OUTPUT_SCALE = 0.1  # of the last layer's initial weights: first displacements are small against the sphere


class DeformationNetwork(nn.Module):
    """Moves a sphere of vision charts so that, with the touch charts, it becomes the object's surface.

    One graph network moves the vertices `config.passes` times. It is given each vertex's position in radii of the sphere from its centre,
    with touch the vertex's mask feature, and with an image the image features pooled at the vertex. Touch charts never move; with tied
    seams, vision vertices that coincide keep doing so to the bit. Equal generators of initial weights give equal networks.
    """

    def __init__(self, config: NetworkConfig, generator: torch.Generator | None = None) -> None:
        super().__init__()
        self.config = config
        self.charts = vision_charts(config.splits)
        self.encoder: ImageEncoder | None = None
        self.linear: nn.Linear | None = None
        pooled = 0
        with torch.random.fork_rng(devices=[]):  # layers draw from torch's own generator; weights are drawn again from ours
            if config.image is not None:
                plan = ENCODER_PLANS[config.encoder_layers]
                self.encoder = ImageEncoder(plan, config.encoder_kernel, config.encoder_norm, config.encoder_width)
                pooled = self.encoder.channels
                if config.encoder_linear is not None:
                    self.linear = nn.Linear(pooled, config.encoder_linear)
                    pooled = config.encoder_linear
            self.gcn = GraphConvolutionNetwork(3 + config.touch + pooled, config.gcn_layers, config.gcn_features, config.mixed)
        draw_weights(self, generator)
        with torch.no_grad():
            self.gcn.last.weight.mul_(INITIAL_OUTPUT_SCALE)

    def forward(
        self,
        *,
        images: Tensor | None,  # (B, 3, H, W) in [0, 1]; None for a network without image
        camera: Tensor | None,  # (3, 4) or (B, 3, 4), world points to pixels of these images; None without image
        touch_vertices: Tensor,  # (T, S, 3) world, m: the charts of one item after the other, S = side²; T is 0 without touch
        touched: Tensor,  # (T,) bool: which of them are of a successful touch
        counts: Sequence[int],  # touch charts of each of B items; they sum to T
    ) -> Tensor:  # (B, V, 3) world, m
        """Deform the vision charts of a batch of B items.

        In evaluation on a CPU, with initial weights, float32 is within 1 µm of float64 and bfloat16 under autocast within 10 mm; with
        instance normalisation within 10 µm and 50 mm.
        """
        if not bool(torch.isfinite(touch_vertices).all()):
            raise InvalidInput("touch_vertices has values that are not finite: leave out the items they come from")
        start = torch.tensor(self.charts.vertices).to(self.gcn.last.weight)  # (V, 3) in radii from the centre
        vision = start.expand(len(counts), -1, -1)  # (B, V, 3)
        touch = (touch_vertices.to(start) - start.new_tensor(self.config.centre)) / self.config.radius  # (T, S, 3)
        graph = chart_graph(self.charts, self.config.side, counts, like=start, touch_edges=self.config.touch_edges)
        mask = torch.where(touched, TOUCHED, NOT_TOUCHED).to(start)[:, None, None].expand(*touch.shape[:2], 1)  # (T, S, 1)
        masks = graph.join(torch.full_like(vision[..., :1], VISION), mask)
        maps = [] if images is None or self.encoder is None else self.encoder(images.to(start.dtype))
        cameras = None if camera is None else camera.to(start).expand(len(counts), 3, 4)
        for _ in range(self.config.passes):
            positions = graph.join(vision, touch)  # (N, 3)
            features = [positions, masks] if self.config.touch else [positions]
            if cameras is not None:
                items = enumerate(torch.split(positions, graph.sizes))
                image_features = [self._image_features(item, [map_[i : i + 1] for map_ in maps], cameras[i]) for i, item in items]
                features.append(torch.cat(image_features))
            moved = graph.vision_vertices(self.gcn(torch.cat(features, dim=1), graph))  # (B, V, 3) radii
            if self.config.seams == "tied":
                moved = self.merge_coinciding(moved)[:, self._position(moved.device)]
            vision = vision + moved
        return self._to_world(vision)

    def merge_coinciding(self, vertices: Tensor) -> Tensor:
        """Average the features (B, V, F) of coinciding vertices: (B, P, F) for the sphere's P distinct positions."""
        position = self._position(vertices.device)
        copies = torch.bincount(position)[:, None]  # (P, 1)
        return vertices.new_zeros(len(vertices), len(copies), vertices.shape[2]).index_add(1, position, vertices) / copies

    def _position(self, device: torch.device) -> Tensor:
        """Get the number of each vertex's distinct position, (V,); not a buffer: unsaved buffers are not restored."""
        return torch.tensor(self.charts.position, device=device)

    def _image_features(self, positions: Tensor, maps: list[Tensor], camera: Tensor) -> Tensor:
        """Pool the image features (n, F) of one item's vertices."""
        assert self.encoder is not None
        pooled = pool_features(maps, self.encoder.grids, project_to_pixels(camera, self._to_world(positions)[None]))[0]
        return pooled if self.linear is None else self.linear(pooled).relu()

    def _to_world(self, positions: Tensor) -> Tensor:
        return positions * self.config.radius + positions.new_tensor(self.config.centre)
