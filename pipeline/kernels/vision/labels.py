"""Labels of the segmentation images."""

from enum import IntEnum


class Label(IntEnum):
    """Label the pixels of a segmentation."""

    BACKGROUND = 0
    OBJECT = 1
    HAND = 2
