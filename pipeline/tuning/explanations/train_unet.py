"""What `train-unet` left out: sensors that felt nothing, pixels that no loss looks at, points that its Chamfer loss need not ask."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from pipeline.dataset.split import load_split
from pipeline.engine.stage import SetJob
from pipeline.kernels.networks.contact_mask import contact_mask
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from pipeline.training.loop import read_metrics
from pipeline.tuning.explain import Count, arrays_read
from schemas.grasps import GRASPS
from schemas.touch import TOUCH
from stages.train_unet.learner import ARRAYS
from stages.train_unet.settings import UnetSettings

OBJECTS = 4
"""Objects of a split whose pixels are counted."""


def explain(job: SetJob) -> Iterator[Count]:
    """Count touches, pixels and epochs of a training."""
    settings: UnetSettings = job.settings
    yield arrays_read(ARRAYS, (TOUCH, GRASPS))
    touch = Collection(Layout(job.data), TOUCH)
    for name in ("train", "valid"):
        split = load_split(job.data, ["touch_success", "untouched"], name)
        success = split.arrays["touch_success"]
        yield Count("readings learnt from", int(success.sum()), int((~success).sum()), "the sensor touched nothing")
        for object_id, touched in list(zip(split.object_ids, success, strict=True))[:OBJECTS]:
            readings = torch.from_numpy(touch.view(object_id)["reading"][touched])
            mask = contact_mask(readings, torch.from_numpy(split.arrays["untouched"]), settings.mask_threshold)
            pixels = int(mask.sum())
            yield Count(
                f"pixels in the loss, of {OBJECTS} objects a split", pixels, mask.numel() - pixels, "they show no contact (supplement 2.2)"
            )
            if settings.loss == "chamfer" and settings.loss_points is not None:
                asked = int(mask.flatten(1).sum(dim=1).clamp(max=settings.loss_points).sum())
                yield Count(
                    f"points looked up each way, of {OBJECTS} objects a split",
                    asked,
                    pixels - asked,
                    "drawn anew each step: unbiased",
                    "fewer loss points",
                )
    done = len(read_metrics(job.folder))
    yield Count("epochs", done, settings.epochs - done, "patience was at its end")
