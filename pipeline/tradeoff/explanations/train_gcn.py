"""What `train-gcn` left out: what the configuration neither sees nor feels, and products with vertices that are no neighbours."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import DatasetJob
from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.networks.chart_graph import chart_graph
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from pipeline.tradeoff.explain import Count, arrays_read
from pipeline.training.items import Items, arrays_of
from pipeline.training.loop import read_metrics
from schemas.charts import CHARTS
from schemas.surfaces import SURFACES
from schemas.vision import VISION
from stages.train_gcn.settings import GcnSettings


def explain(job: DatasetJob) -> Iterator[Count]:
    """Count what a training of one configuration looks at."""
    settings: GcnSettings = job.settings
    items = Items(job.data, "train", settings.named, settings.samples_per_object)
    config = settings.network(items.side)
    yield Count("configurations trained", 1, len(CONFIGURATIONS) - 1, "each is a training of its own, and none needs another")
    artifacts = (SURFACES, *([VISION] if config.image else []), *([CHARTS] if config.touch else []))
    yield arrays_read(arrays_of(config), artifacts)
    charts = 0
    if config.touch:
        charts = min(settings.max_grasps, items.grasps) * items.rows.size("stop_rule", "sensor")
    graph = chart_graph(vision_charts(config.splits), config.side, [charts], like=torch.zeros(()))
    neighbours, size = graph.adjacency.values().numel(), sum(graph.sizes)
    yield Count("pairs of vertices averaged, per item", neighbours, size**2 - neighbours, "no neighbours", "sparse neighbours")
    points = ObjectRows(job.data, ["points"], "valid").size("points", "point")
    asked = min(settings.loss_points, points)
    yield Count("points of the object asked, per item", asked, points - asked, "drawn again each step; all are there to be near")
    done = len(read_metrics(job.folder))
    yield Count("epochs", done, settings.epochs - done, "patience was at its end")
