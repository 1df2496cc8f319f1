"""Find the dots that are printed on a gel in its photographs, and fill them in from what is around them.

Valid range: twelve or more dots of one colour and about one size, 3 pixels wide or more, and as far apart as they are wide. A dot stands
out from the median of its neighbourhood.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.ndimage import median_filter
from skimage.measure import label, regionprops
from skimage.morphology import dilation, disk
from skimage.restoration import inpaint_biharmonic
from skimage.transform import resize

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Mask

SIDE = 320  # pixels along the longer side at which dots are searched
SHARE, WINDOW = 4, 7  # the median is taken of 7 × 7 squares of 4 × 4 pixels: dots fill less than half of them
LEAST_DOTS, LEAST_AREA, LEAST_CONTRAST = 12, 9, 15.0  # fewer, smaller (pixels) or weaker (levels) spots are dust
COVERED = 0.98  # quantile of the deviations that is as large as a dot's, where dots cover more than 2 % of the gel
ROUND = 0.8  # least share of a spot's convex hull that a dot fills
ALIKE = 2.5  # largest factor between the area of a dot at rest and the median one
STRETCHED = 6.0  # the same in a touched photograph
SEEN = 0.5  # least share of the dots that a touched photograph must show
BLURRED = 0.4  # of a dot's radius, and a pixel: how far beyond it is filled in, for its rim is blurred


class MarkerRemoval:
    """Fills in the dots of a gel in its photographs; those of a gel without dots stay as they are."""

    def __init__(self, untouched: NDArray[np.uint8]) -> None:  # (rows, cols, 3)
        deviation = _deviation(untouched)
        size = np.linalg.norm(deviation, axis=2)
        stands_out = size > max(LEAST_CONTRAST, np.quantile(size, COVERED) / 2)
        spots = [spot for spot in regionprops(label(stands_out)) if spot.area >= LEAST_AREA]
        areas = np.array([spot.area for spot in spots])
        dots = [spot for spot in spots if 1 / ALIKE < spot.area / np.median(areas) < ALIKE and spot.solidity > ROUND]
        self.count = len(dots) if len(dots) >= max(LEAST_DOTS, len(spots) / 2) else 0
        if self.count:
            self.area = float(np.median(areas))
            colour = np.mean([deviation[tuple(spot.coords.T)].mean(axis=0) for spot in dots], axis=0)
            self.contrast = float(np.linalg.norm(colour))
            self.colour: Array = colour / self.contrast

    def fill(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:  # (rows, cols, 3)
        """Fill in the dots of a photograph; an `InvalidInput` if most of them are not found."""
        if not self.count:
            return image
        dots, count = self._find(image)
        if count < SEEN * self.count:
            raise InvalidInput(
                f"it shows {count} of the {self.count} dots that are printed on the untouched gel, {100 * SEEN:.0f} % are needed to fill "
                "them in; take both photographs with one sensor, in focus"
            )
        filled = inpaint_biharmonic(image / 255, dots, channel_axis=2)
        return np.where(dots[..., None], np.rint(255 * np.clip(filled, 0, 1)).astype(np.uint8), image)

    def middles(self, image: NDArray[np.uint8]) -> Array:  # (N, 2) x and y, pixels
        """Find the middles of the dots in a photograph, but for those that its rim cuts."""
        deviation = _deviation(image) @ self.colour
        above = np.maximum(deviation - self.contrast / 3, 0)  # so that pixels at the rim of a dot hardly count
        spots, count = ndimage.label(above)
        areas = np.bincount(spots.ravel()) / self.area
        cut = np.isin(np.arange(count + 1), np.concatenate([spots[0], spots[-1], spots[:, 0], spots[:, -1], [0]]))
        alike = np.flatnonzero((areas > 1 / ALIKE) & (areas < ALIKE) & ~cut)
        middles = np.reshape(ndimage.center_of_mass(above, spots, alike), (-1, 2))[:, ::-1]
        return np.asarray((middles + 0.5) * np.array(image.shape[1::-1]) / deviation.shape[::-1] - 0.5)

    def _find(self, image: NDArray[np.uint8]) -> tuple[Mask, int]:
        """Find the pixels of dots, and count the dots."""
        spots = label(_deviation(image) @ self.colour > self.contrast / 3)
        areas = np.bincount(spots.ravel()) / self.area
        kept = (areas > 1 / STRETCHED) & (areas < STRETCHED)
        kept[0] = False
        dots = dilation(kept[spots], disk(1 + round(BLURRED * float(np.sqrt(self.area / np.pi)))))
        return np.asarray(resize(dots, image.shape[:2], order=0)), int(kept.sum())


def _deviation(image: NDArray[np.uint8]) -> Array:  # (rows, cols, 3) levels; at most `SIDE` rows and columns
    """Compute by how much each pixel differs from the median of its neighbourhood."""
    scale = min(1.0, SIDE / max(image.shape[:2]))
    rows, cols = (max(SHARE, round(scale * side)) for side in image.shape[:2])
    fine, coarse = (resize(image, (rows // share, cols // share), preserve_range=True, anti_aliasing=True) for share in (1, SHARE))
    median = np.stack([median_filter(channel, WINDOW) for channel in np.moveaxis(coarse, 2, 0)], axis=-1)
    return np.asarray(fine - resize(median, fine.shape))
