"""Find the background of an image by the colour of its border."""

import numpy as np

from pipeline.kernels.vision.view_transfer import foreground


def test_the_foreground_differs_from_most_of_the_border():
    image = np.full((20, 30, 3), 230, np.uint8)
    image[5:20, 10:14] = (228, 120, 230)  # reaches the border
    image[0, 0] += 4
    mask = foreground(image)
    assert mask.sum() == 15 * 4
    assert mask[5:, 10:14].all()
