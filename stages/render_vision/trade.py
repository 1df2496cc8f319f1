"""The trade-off of `render-vision`: the difference of coarser images from a fine one."""

from pathlib import Path

import numpy as np
from skimage.transform import resize

from pipeline.dataset.paired_rows import paired_rows
from pipeline.engine.trade import Trade


def image_differences(data: Path, reference: Path) -> dict[str, float]:
    """Compare images, enlarged to the reference's size, with it: RMS by object, levels of 255."""
    differences = {}
    for name, (image,), (truth,) in paired_rows(data, reference, "unoccluded"):
        enlarged = resize(image / 255.0, truth.shape, order=1)
        differences[name] = 255 * float(np.sqrt(np.square(enlarged - truth / 255.0).mean()))
    return differences


TRADE = Trade(
    metric="difference from an image of four times as many pixels, RMS",
    unit="levels",
    candidates=({"resolution": 64}, {"resolution": 128}, {"resolution": 192}, {"resolution": 384}),
    errors=image_differences,
    reference={"resolution": 512},
)
