"""Blades of knives: a silhouette and a grind. Along x from 0, edge down, in millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.toy_objects.shapes import Solid, loft, smooth

Outline = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Blade:
    """A blade from x = 0 to `length`.

    `outline` rows (x / length, top / height, bottom / height), top rising to the spine; `thick` at the spine; the bevel
    takes the share `grind` of the height; `teeth` of depth `bite` (both of the height) along the edge; `double` edged.
    """

    length: float
    height: float
    thick: float
    outline: Outline
    grind: float = 0.7
    teeth: int = 0
    bite: float = 0.0
    double: bool = False

    def solid(self) -> Solid:
        """The blade, reaching a little into the handle."""
        table = smooth(self.outline, 8)
        fine = np.linspace(0.0, 1.0, max(60, 8 * self.teeth))
        share = np.unique(np.concatenate([fine, table[:, 0]]).round(3))  # rounded: no slivers
        top, bottom = (np.interp(share, table[:, 0], table[:, i]) * self.height for i in (1, 2))
        if self.teeth:
            wave = np.abs(np.sin(np.pi * self.teeth * share)) * np.clip(20.0 * (0.97 - share), 0.0, 1.0)
            bottom = bottom + self.bite * self.height * (1.0 - wave) * (share > 0.04)
        # the point keeps a twelfth of the height's room, and the blade thins towards it
        half = self.thick / 2.0 * np.interp(share, [0.0, 0.6, 1.0], [1.0, 0.9, 0.4])
        half = np.minimum(half, 0.35 * (top - bottom) + 0.1)
        return loft(self._sections(share * self.length, top, bottom, half), first=[-0.03 * self.length, 0.0, 0.85 * top[0]])

    def _sections(self, x: NDArray[np.float64], *shape: NDArray[np.float64]) -> NDArray[np.float64]:
        top, bottom, half = shape
        edge = 0.14 * half
        middle = (top + bottom) / 2.0
        shoulder = bottom + self.grind * (top - bottom)
        if self.double:
            z = [top, middle, bottom, bottom, middle, top]
            y = [edge, half, edge, -edge, -half, -edge]
        else:
            z = [top, shoulder, bottom, bottom, shoulder, top]
            y = [0.85 * half, half, edge, -edge, -half, -0.85 * half]
        return np.stack([np.stack([x, w, h], axis=-1) for w, h in zip(y, z, strict=True)], axis=1)
