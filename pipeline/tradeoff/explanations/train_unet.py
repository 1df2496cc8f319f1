"""What `train-unet` left out: sensors that felt nothing, pixels that no loss looks at."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import DatasetJob
from pipeline.kernels.networks.contact_mask import contact_mask
from pipeline.tradeoff.explain import Count, arrays_read
from pipeline.training.loop import read_metrics
from schemas.grasps import GRASPS
from schemas.touch import TOUCH
from stages.train_unet.learner import ARRAYS
from stages.train_unet.settings import UnetSettings

OBJECTS = 4
"""Objects of a split whose pixels are counted."""


def explain(job: DatasetJob) -> Iterator[Count]:
    """Count touches, pixels and epochs of a training."""
    settings: UnetSettings = job.settings
    yield arrays_read(ARRAYS, (TOUCH, GRASPS))
    for name in ("train", "valid"):
        rows = ObjectRows(job.data, ["touch_success", "untouched", "tactile_image"], name)
        untouched = torch.tensor(rows.read("untouched", rows.object_ids[0])[0])
        success = np.stack([rows.read("touch_success", object_id) for object_id in rows.object_ids])
        yield Count("tactile images learnt from", int(success.sum()), int((~success).sum()), "the sensor touched nothing")
        for object_id, touched in list(zip(rows.object_ids, success, strict=True))[:OBJECTS]:
            tactile_images = torch.from_numpy(rows.read("tactile_image", object_id)[touched])
            mask = contact_mask(tactile_images, untouched, settings.mask_threshold)
            pixels = int(mask.sum())
            what = f"pixels in the loss, of {OBJECTS} objects per split"
            yield Count(what, pixels, mask.numel() - pixels, "they show no contact (supplement 2.2)")
    done = len(read_metrics(job.folder))
    yield Count("epochs", done, settings.epochs - done, "patience was at its end")
