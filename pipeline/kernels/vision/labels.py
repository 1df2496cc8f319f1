"""Labels of the segmentation images."""

from enum import IntEnum


class Label(IntEnum):
    """What a pixel of a segmentation shows."""

    BACKGROUND = 0
    OBJECT = 1
    HAND = 2
