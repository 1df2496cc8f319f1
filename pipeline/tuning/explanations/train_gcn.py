"""What `train-gcn` left out: what the configuration neither sees nor feels, and what does not change from pass to pass."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import DatasetJob
from pipeline.kernels.charts.chart_sphere import chart_sphere
from pipeline.kernels.charts.chart_square import SIDE
from pipeline.kernels.networks.configurations import CONFIGURATIONS
from pipeline.kernels.networks.graph import batch_graph
from pipeline.training.loop import read_metrics
from pipeline.tuning.explain import Count, arrays_read
from schemas.charts import CHARTS
from schemas.surfaces import SURFACES
from schemas.vision import VISION
from stages.train_gcn.items import arrays_of
from stages.train_gcn.settings import GcnSettings
from stages.train_gcn.stage import chart_side


def explain(job: DatasetJob) -> Iterator[Count]:
    """Count what a training of one configuration looks at."""
    settings: GcnSettings = job.settings
    config = settings.network(chart_side(job.data) if settings.named.touch else SIDE)
    yield Count("configurations trained", 1, len(CONFIGURATIONS) - 1, "each is a training of its own, and none needs another")
    artifacts = (SURFACES, *([VISION] if config.image else []), *([CHARTS] if config.touch else []))
    yield arrays_read(arrays_of(config), artifacts)
    if config.image is not None:
        yield Count("runs of the image encoder, a step", 1, config.passes - 1, "the image is the same in every pass")
    charts = 0
    if config.touch:
        rows = ObjectRows(job.data, ["stop_rule"], "train")
        charts = min(settings.max_grasps, rows.size("stop_rule", "grasp")) * rows.size("stop_rule", "sensor")
        touch_vertices = charts * config.side**2
        yield Count(
            "features of touch vertices, an item",
            touch_vertices,
            touch_vertices * (config.passes - 1),
            "they never move: the same in every pass",
        )
    graph = batch_graph(chart_sphere(config.splits), config.side, [charts], torch.device("cpu"), torch.float32)
    neighbours = graph.mean.values().numel()
    size = sum(graph.sizes)
    yield Count("pairs of vertices averaged, an item", neighbours, size**2 - neighbours, "no neighbours", "sparse neighbours")
    if graph.cuts:
        layers = min(len(graph.cuts), config.gcn_layers - 1)
        entering = sum(len(cut.entering) for cut in graph.cuts[:layers])
        why = "no vertex that moves is near enough to learn of them"
        yield Count(f"vertices in the last {layers} layers, an item", entering, layers * size - entering, why)
    points = ObjectRows(job.data, ["points"], "valid").size("points", "point")
    asked = min(settings.loss_points, points)
    yield Count("points of the object asked, an item", asked, points - asked, "drawn anew each step; all are there to be near", "")
    done = len(read_metrics(job.folder))
    yield Count("epochs", done, settings.epochs - done, "patience was at its end")
