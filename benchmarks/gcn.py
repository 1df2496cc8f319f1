"""Measure a training step of Table 7's graph network, sparse and as a dense twin, each in its own process for its peak memory."""

import resource
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from benchmarks.timing import Table
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.networks.deformation_network import VISION, DeformationNetwork, ZeroNeighbourLayer, chart_graph
from pipeline.kernels.networks.image_encoder import pool_features, project_to_pixels
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from pipeline.kernels.vision.camera import projection_matrix

BATCH = 16
TWIN_BATCH = 2
"""Items of the twin's step, whose time is scaled to `BATCH`: a full batch would take minutes."""
SENSORS = 4
Forward = Callable[..., Tensor]
StepInputs = dict[str, Any]


def measure(data: Path, turns: int) -> Table:
    """Measure one step of each network; no dataset is needed."""
    config = CONFIGURATIONS["occluded-touch"]
    note = (
        f"{config.gcn_layers} × {config.gcn_features}, processor seconds of one thread. The twin has a dense adjacency and the image "
        f"encoder in every pass; its seconds are those of {TWIN_BATCH} items × {BATCH // TWIN_BATCH}. Losses are of {TWIN_BATCH} items."
    )
    table = Table(f"Graph network: one training step of Table 7, batch {BATCH}", ["s", "÷ twin", "peak GB", "loss", "twin's"], [note])
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        for grasps in (1, 5):
            (sparse, peak, _), (_, _, loss), (twin, _, twin_loss) = pool.map(
                step, [grasps] * 3, [BATCH, TWIN_BATCH, TWIN_BATCH], [False, False, True]
            )
            ratio = sparse / (twin * BATCH / TWIN_BATCH)
            table.add(f"grasps: {grasps}", f"{sparse:.1f}", f"{ratio:.2f}", f"{peak:.2f}", f"{loss:.7f}", f"{twin_loss:.7f}")
    return table


def batch(items: int, grasps: int) -> StepInputs:
    """Make the inputs of a step: random images, and touch charts at random places around the object."""
    generator = torch.Generator().manual_seed(0)
    charts = items * grasps * SENSORS
    images = torch.rand(items, 3, 256, 256, generator=generator)
    camera = torch.from_numpy(projection_matrix(load_scene("supplement").camera))
    sites = torch.rand(charts, 1, 3, generator=generator) * 0.3 + torch.tensor([-0.15, -0.15, 0.45])
    vertices = sites + 0.016 * torch.rand(charts, 81, 3, generator=generator)
    touched = torch.rand(charts, generator=generator) < 0.63
    return {"images": images, "camera": camera, "touch_vertices": vertices, "touched": touched, "counts": [grasps * SENSORS] * items}


def dense_twin(network: DeformationNetwork) -> Forward:
    """Make the network's forward pass with a dense adjacency, one for all items, and the image encoder in every pass."""

    def forward(*, images: Tensor, camera: Tensor, touch_vertices: Tensor, touched: Tensor, counts: Sequence[int]) -> Tensor:
        assert network.encoder is not None
        items, config = len(counts), network.config
        camera, centre = camera.float(), torch.tensor(config.centre)
        graph = chart_graph(network.charts, config.side, counts[:1], like=camera)
        averaging = graph.adjacency.to_dense() / graph.degree
        start = torch.tensor(network.charts.vertices).float().expand(items, -1, -1)
        vertices = torch.cat([start, ((touch_vertices - centre) / config.radius).reshape(items, -1, 3)], dim=1)
        kinds = torch.where(touched, 1.0, -1.0).repeat_interleave(touch_vertices.shape[1]).reshape(items, -1)
        kinds = torch.cat([torch.full(start.shape[:2], VISION), kinds], dim=1)[..., None]
        for _ in range(config.passes):
            pixels = project_to_pixels(camera, vertices * config.radius + centre)
            pooled = pool_features(network.encoder(images), network.encoder.grids, pixels)
            features = torch.cat([vertices, kinds, pooled], dim=-1)
            for layer in network.gcn.hidden:
                assert isinstance(layer, ZeroNeighbourLayer)
                mapped = layer.linear(features)
                features = torch.cat([averaging @ mapped[..., : layer.mixed], mapped[..., layer.mixed :]], dim=-1).relu()
            moved = network.gcn.last(features)
            vertices = torch.cat([vertices[:, : start.shape[1]] + moved[:, : start.shape[1]], vertices[:, start.shape[1] :]], dim=1)
        return vertices[:, : start.shape[1]] * config.radius + centre

    return forward


def step(grasps: int, items: int, twin: bool) -> tuple[float, float, float]:
    """Measure seconds, peak memory in GB, and loss of a step; instead of its Chamfer loss, every vertex is drawn to a smaller sphere."""
    torch.set_num_threads(1)
    network = DeformationNetwork(CONFIGURATIONS["occluded-touch"], torch.Generator().manual_seed(0))
    forward: Forward = dense_twin(network) if twin else network
    inputs, before = batch(items, grasps), time.process_time()
    radii = (forward(**inputs) - torch.tensor(network.config.centre)).norm(dim=-1)
    loss = (radii - 0.2).square().mean()
    loss.backward()  # type: ignore[no-untyped-call]
    seconds, peak = time.process_time() - before, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    return seconds, peak, loss.item()
