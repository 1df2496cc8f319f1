"""Training steps of the graph network, sparse beside a dense twin, and of narrow networks. `python -m benchmarks.gcn [--narrow]`.

The twin is the same network with a dense adjacency and the image encoder in every pass. Every figure comes from a process of its
own, whose peak memory stands beside it; seconds are of the processor, one thread, so that other work on the machine counts little.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from pipeline.formats.scene_file import load_scene
from pipeline.kernels.networks.chart_graph import chart_graph
from pipeline.kernels.networks.deformation_network import VISION, DeformationNetwork
from pipeline.kernels.networks.graph_convolution import ZeroNeighbourLayer
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from pipeline.kernels.networks.perceptual_pooling import pool_features, project_to_pixels
from pipeline.kernels.vision.camera import projection_matrix

BATCH = 16
TWIN_BATCH = 2
"""Items of the twin's step, which is scaled to `BATCH`: all of them would take minutes."""
SENSORS = 4
NARROW = [(8, 64), (10, 64), (10, 96), (15, 64), (15, 96)]
"""Layers and features of narrow graph networks; their image encoders have half the channels."""
Forward = Callable[..., Tensor]
Given = dict[str, Any]


def batch(items: int, grasps: int) -> Given:
    """Inputs of a step: random images, and touch charts strewn about the object."""
    generator = torch.Generator().manual_seed(0)
    charts = items * grasps * SENSORS
    images = torch.rand(items, 3, 256, 256, generator=generator)
    camera = torch.from_numpy(projection_matrix(load_scene("supplement").camera))
    sites = torch.rand(charts, 1, 3, generator=generator) * 0.3 + torch.tensor([-0.15, -0.15, 0.45])
    vertices = sites + 0.016 * torch.rand(charts, 81, 3, generator=generator)
    touched = torch.rand(charts, generator=generator) < 0.63
    return {"images": images, "camera": camera, "touch_vertices": vertices, "touched": touched, "counts": [grasps * SENSORS] * items}


def dense_twin(network: DeformationNetwork) -> Forward:
    """The network's forward pass with a dense adjacency, one for all items, and the image encoder in every pass."""

    def forward(*, images: Tensor, camera: Tensor, touch_vertices: Tensor, touched: Tensor, counts: Sequence[int]) -> Tensor:
        assert network.encoder is not None
        items, config = len(counts), network.config
        camera, centre = camera.float(), torch.tensor(config.centre)
        graph = chart_graph(network.charts, config.side, counts[:1], like=camera)
        mean = graph.adjacency.to_dense() / graph.degree
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
                features = torch.cat([mean @ mapped[..., : layer.mixed], mapped[..., layer.mixed :]], dim=-1).relu()
            moved = network.gcn.last(features)
            vertices = torch.cat([vertices[:, : start.shape[1]] + moved[:, : start.shape[1]], vertices[:, start.shape[1] :]], dim=1)
        return vertices[:, : start.shape[1]] * config.radius + centre

    return forward


def step(forward: Forward, network: DeformationNetwork, given: Given) -> float:
    """One training step but for its Chamfer loss: every vertex is drawn to a smaller sphere. Returns the loss."""
    network.zero_grad()
    radii = (forward(**given) - torch.tensor(network.config.centre)).norm(dim=-1)
    loss = (radii - 0.2).square().mean()
    loss.backward()
    return loss.item()


def measure(layers: int, features: int, width: float, grasps: int, items: int, twin: bool) -> None:
    """Print seconds a step, peak memory and loss, as JSON."""
    torch.set_num_threads(1)
    sizes = {"gcn_layers": layers, "gcn_features": features, "encoder_width": width}
    network = DeformationNetwork(CONFIGURATIONS["occluded-touch"].model_copy(update=sizes), torch.Generator().manual_seed(0))
    forward: Forward = dense_twin(network) if twin else network
    given = batch(items, grasps)
    before, wall = time.process_time(), time.perf_counter()
    loss = step(forward, network, given)
    seconds, wall = time.process_time() - before, time.perf_counter() - wall
    gigabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    print(json.dumps({"seconds": seconds, "wall": wall, "gigabytes": gigabytes, "loss": loss}))


def measured(layers: int, features: int, width: float, grasps: int, items: int, twin: bool = False) -> dict[str, float]:
    """`measure` in a process of its own."""
    arguments = [str(value) for value in (layers, features, width, grasps, items, int(twin))]
    done = subprocess.run([sys.executable, "-m", "benchmarks.gcn", "--measure", *arguments], capture_output=True, text=True, check=True)
    result: dict[str, float] = json.loads(done.stdout)
    return result


def beside_the_twin() -> None:
    config = CONFIGURATIONS["occluded-touch"]
    size = config.gcn_layers, config.gcn_features, config.encoder_width
    print(f"Table 7's network ({size[0]} x {size[1]}), batch {BATCH}; twin's seconds: those of {TWIN_BATCH} items x {BATCH // TWIN_BATCH}.")
    print(f"{'grasps':>6}  {'sparse s':>8}  {'peak GB':>7}  {'twin s':>7}  {'ratio':>5}  {'losses of ' + str(TWIN_BATCH) + ' items':>22}")
    for grasps in (1, 5):
        sparse = measured(*size, grasps, BATCH)
        alike = measured(*size, grasps, TWIN_BATCH)["loss"]
        twin = measured(*size, grasps, TWIN_BATCH, twin=True)
        seconds = twin["seconds"] * BATCH / TWIN_BATCH
        cells = f"{sparse['seconds']:8.1f}  {sparse['gigabytes']:7.2f}  {seconds:7.1f}  {sparse['seconds'] / seconds:5.2f}"
        print(f"{grasps:6}  {cells}  {alike:10.7f} {twin['loss']:10.7f}", flush=True)


def narrow() -> None:
    print(f"Narrow networks with image and touch, encoders of half the channels, batch {BATCH}, 3 grasps.")
    print(f"{'layers x features':>17}  {'s a step':>8}  {'wall s':>6}  {'peak GB':>7}")
    for layers, features in NARROW:
        row = measured(layers, features, 0.5, 3, BATCH)
        print(f"{layers:8} x {features:6}  {row['seconds']:8.2f}  {row['wall']:6.2f}  {row['gigabytes']:7.2f}", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--narrow", action="store_true", help="only narrow networks")
    parser.add_argument("--measure", nargs=6, type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        layers, features, width, grasps, items, twin = options.measure
        measure(int(layers), int(features), width, int(grasps), int(items), bool(twin))
        return
    if not options.narrow:
        beside_the_twin()
    narrow()


if __name__ == "__main__":
    main()
