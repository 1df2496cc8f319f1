"""What a stage asks of any renderer: to take meshes in, and to make images of some of them where they stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.vision.camera import Camera, Vector


class Label(IntEnum):
    """What a pixel of a segmentation shows."""

    BACKGROUND = 0
    OBJECT = 1
    HAND = 2


@dataclass(frozen=True)
class View:
    """An image and what each of its pixels shows.

    `rgb` (R, R, 3) uint8, sRGB, antialiased; `segmentation` (R, R) uint8 of `Label`, what the ray through the pixel's centre meets.
    """

    rgb: NDArray[np.uint8]
    segmentation: NDArray[np.uint8]


@dataclass(frozen=True)
class Part:
    """A mesh that a renderer has taken in: its number there."""

    number: int


Placed = tuple[Part, NDArray[np.float64]]
"""A part and its frame in the world, (4, 4)."""


class Renderer(Protocol):
    """Takes meshes in once and makes any number of images of them."""

    def add(self, mesh: Mesh, label: Label) -> Part:
        """Take a mesh in; it is in no image until `render` names it."""

    def remove(self, part: Part) -> None:
        """Forget a mesh and free what it took."""

    def render(self, parts: Sequence[Placed], camera: Camera | None = None, lamp: Vector | None = None) -> View:
        """An image of these parts and nothing else; another `camera` than the scene's may look, the `lamp` may stand elsewhere."""
