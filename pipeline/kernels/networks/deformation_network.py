"""The network that deforms vision charts around touch charts: image encoder, perceptual pooling, graph network (Tables 6-11).

Graph convolutions are those of supplement 3.1 and 3.2, after GEOMetrics, on the graph that the vertices of all charts form.
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import linear

from pipeline.errors import InvalidInput
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.charts.vision_charts import VisionCharts, vision_charts
from pipeline.kernels.geometry.mesh import directed_edges
from pipeline.kernels.networks.image_encoder import ImageEncoder, pool_features, project_to_pixels
from pipeline.kernels.networks.network_configurations import NetworkConfig, TouchEdges
from pipeline.kernels.tensors import draw_weights

VISION, TOUCHED, NOT_TOUCHED = 0.0, 1.0, -1.0  # mask feature: vision chart, chart of a successful touch, other touch chart
INITIAL_OUTPUT_SCALE = 0.1  # of the last layer's initial weights: first displacements are small against the sphere


@dataclass(frozen=True, eq=False)
class ChartGraph:
    """The neighbourhoods of the N vertices of a batch of B items.

    Item b has its V vision vertices first, then `counts[b]` touch charts of side² vertices; then item b + 1 follows. Two vertices are
    neighbours where a chart's edge joins them, where they are vision vertices that coincide, or where one is the centre of a touch
    chart and the other the centre of a vision chart. Each vertex is its own neighbour. With touch edges to all vision vertices, the
    centres of touch charts are neighbours of each vision vertex of their item instead, and have no vision vertex for a neighbour.
    """

    adjacency: Tensor  # (N, N) sparse CSR, symmetric: 1 where two vertices are neighbours
    degree: Tensor  # (N, 1) the neighbours of each vertex
    counts: list[int]  # touch charts of each item
    sizes: list[int]  # vertices of each item: V + counts[b] · side²
    vision_size: int  # V
    touch_centres: Tensor | None = None  # (T,) that are also neighbours of all vision vertices of their item

    def average(self, features: Tensor) -> Tensor:
        """Average features (N, F) over the neighbours of each vertex, in the adjacency's precision: (N, F), of the features' type."""
        with torch.autocast(features.device.type, enabled=False):  # sparse products know no half precision on a CPU
            full = features.to(self.adjacency.dtype)
            summed: Tensor = _SymmetricProduct.apply(self.adjacency, full)  # type: ignore[no-untyped-call]
            if self.touch_centres is not None:
                summed = summed + self.sum_touch_centres(full[self.touch_centres])
            return (summed / self.degree).to(features.dtype)

    def sum_touch_centres(self, features: Tensor) -> Tensor:
        """Sum the features (T, F) of each item's touch charts for its vision vertices; 0 for the other vertices: (N, F)."""
        sums = []
        for part, size in zip(torch.split(features, self.counts), self.sizes, strict=True):
            sums += [part.sum(dim=0).expand(self.vision_size, -1), part.new_zeros(size - self.vision_size, part.shape[1])]
        return torch.cat(sums)

    def join(self, vision: Tensor, touch: Tensor) -> Tensor:
        """Arrange features of vision vertices (B, V, F) and of touch charts (T, side², F) as those of all vertices: (N, F)."""
        items = zip(vision, torch.split(touch, self.counts), strict=True)
        return torch.cat([part.reshape(-1, vision.shape[-1]) for item in items for part in item])

    def vision_vertices(self, features: Tensor) -> Tensor:
        """Select the vision vertices' rows of `features` (N, F): (B, V, F)."""
        return torch.stack([item[: self.vision_size] for item in torch.split(features, self.sizes)])


class _SymmetricProduct(torch.autograd.Function):
    """A product with a symmetric sparse matrix, whose gradient is such a product too; torch's own transposes the matrix in each pass.

    That takes 14 times as long as the product, and made a training step of the draft touch network 1.8 times as long.
    """

    @staticmethod
    def forward(ctx: Any, matrix: Tensor, features: Tensor) -> Tensor:
        ctx.save_for_backward(matrix)
        return matrix @ features

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[None, Tensor]:
        (matrix,) = ctx.saved_tensors
        return None, matrix @ gradient


def chart_graph(
    charts: VisionCharts,  # of each item
    side: int,  # vertices along a side of a touch chart
    counts: Sequence[int],  # touch charts of each of B items
    like: Tensor,  # float32 or float64: its device and type are the adjacency's
    *,
    touch_edges: TouchEdges = "centres",  # which vision vertices touch charts are joined to; see `NetworkConfig`
) -> ChartGraph:
    """Build the graph of a batch: of N vertices, vision charts before touch charts in each item."""
    mutual = touch_edges == "centres"
    items = [_item_adjacency(charts, side, count, mutual=mutual) for count in counts]
    matrix = scipy.sparse.block_diag(items, format="csr")
    csr = matrix.indptr, matrix.indices, matrix.data
    with warnings.catch_warnings():  # torch warns that its interface may change
        warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
        adjacency = torch.sparse_csr_tensor(*csr, matrix.shape, dtype=like.dtype, device=like.device, check_invariants=False)
    degree = torch.from_numpy(np.diff(matrix.indptr)).to(like)[:, None]
    graph = ChartGraph(adjacency, degree, list(counts), [item.shape[0] for item in items], len(charts.vertices))
    return graph if mutual else _connect_touch_to_all_vision(graph, charts, side)


def _connect_touch_to_all_vision(graph: ChartGraph, charts: VisionCharts, side: int) -> ChartGraph:
    """Give each vision vertex the centres of its item's touch charts for neighbours."""
    starts = np.cumsum([0, *graph.sizes[:-1]])
    centres = [start + _touch_centres(charts, side, count) for start, count in zip(starts, graph.counts, strict=True)]
    touch_centres = torch.from_numpy(np.concatenate(centres)).to(graph.degree.device)
    return replace(
        graph, touch_centres=touch_centres, degree=graph.degree + graph.sum_touch_centres(graph.degree.new_ones(len(touch_centres), 1))
    )


def _touch_centres(charts: VisionCharts, side: int, count: int) -> NDArray[np.int64]:  # (count,)
    """Compute the number of the middle vertex of each touch chart of one item."""
    return len(charts.vertices) + side**2 * np.arange(count) + side**2 // 2


@lru_cache(maxsize=32)  # the counts of touch charts of a dataset's items
def _item_adjacency(charts: VisionCharts, side: int, count: int, *, mutual: bool) -> "scipy.sparse.csr_array":  # (n, n)
    """Make an item's matrix: 1 where vertices are neighbours, with `mutual` also centres of touch and vision charts."""
    square, square_faces = chart_square(side)
    first_vertices = len(charts.vertices) + len(square) * np.arange(count)  # (count,) of each touch chart
    touch_faces = (square_faces.numpy() + first_vertices[:, None, None]).reshape(-1, 3)
    faces = np.concatenate([charts.faces, touch_faces])
    pairs = np.concatenate([directed_edges(faces), charts.seams])
    if mutual:
        centres = np.stack(np.meshgrid(_touch_centres(charts, side, count), charts.centres), axis=-1).reshape(-1, 2)
        pairs = np.concatenate([pairs, centres])
    size = len(charts.vertices) + count * len(square)
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    neighbours = scipy.sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(size, size)) + scipy.sparse.eye_array(size)
    neighbours.data[:] = 1  # a side of two faces was counted twice
    return neighbours


class ZeroNeighbourLayer(nn.Module):
    """Map each vertex's features linearly, average the first of them, a share `mixed`, over neighbours, and apply a ReLU."""

    def __init__(self, in_features: int, out_features: int, mixed: float = 1 / 3) -> None:
        super().__init__()
        self.linear = nn.Linear(in_features, out_features)
        self.mixed = math.floor(mixed * out_features)

    def forward(self, features: Tensor, graph: ChartGraph) -> Tensor:  # (N, out_features)
        """Compute the layer's output from features (N, in_features); values that are not finite spread to the neighbours."""
        weight, bias = self.linear.weight, self.linear.bias
        unmixed = linear(features, weight[self.mixed :], bias[self.mixed :])
        averaged = linear(features, weight[: self.mixed], bias[: self.mixed])
        return torch.cat([graph.average(averaged), unmixed], dim=1).relu_()


class GraphConvolutionNetwork(nn.Module):
    """Zero-neighbour layers, and a linear one that gives each vertex's displacement: `layers` in all, 2 at least."""

    def __init__(self, in_features: int, layers: int, features: int, mixed: float = 1 / 3) -> None:
        super().__init__()
        widths = [in_features, *[features] * (layers - 1)]
        self.hidden = nn.ModuleList(ZeroNeighbourLayer(before, after, mixed) for before, after in pairwise(widths))
        self.last = nn.Linear(features, 3)

    def forward(self, features: Tensor, graph: ChartGraph) -> Tensor:
        """Compute displacements (N, 3) of a graph's vertices from their features (N, in_features)."""
        for layer in self.hidden:
            features = layer(features, graph)
        with torch.autocast(features.device.type, enabled=False):  # half precision would move vertices in steps of a millimetre
            displacements: Tensor = self.last(features.to(self.last.weight.dtype))
        return displacements


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
                self.encoder = ImageEncoder(config)
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
