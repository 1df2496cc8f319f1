"""The undeformed touch chart: a square grid of vertices on the sensor plane (supplement 2.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

SIDE = 9
"""Vertices along a side: 81 vertices and 128 faces, the supplement's."""
MAX_SIDE = 101
"""More vertices would be finer than any tactile image resolves."""


def chart_square(
    side: int = SIDE,  # vertices along a side; odd, so that one of them, with index side² // 2, is the centre
    aspect: float = 1.0,  # the sensor's height over its width
) -> tuple[Tensor, Tensor]:  # (side², 3) float64, sensor widths, and (2 (side - 1)², 3) int64
    """Make the vertices and faces of a planar chart as large as the sensor, in the plane z = 0 of the sensor frame.

    x goes from -1/2 to 1/2 along a row, y from -aspect/2 to aspect/2 from row to row, as pixels do. Faces are wound so
    that normals are +z.
    """
    if side % 2 == 0 or not 3 <= side <= MAX_SIDE:
        raise ValueError(f"a chart of side {side}: its side is odd, so that it has a centre, and 3 to {MAX_SIDE}; {SIDE} in the supplement")
    import torch  # takes a second, which readers of settings save

    along = torch.arange(side, dtype=torch.float64) / (side - 1) - 0.5
    y, x = torch.meshgrid(aspect * along, along, indexing="ij")
    vertices = torch.stack([x, y, torch.zeros_like(x)], dim=-1).reshape(-1, 3)
    index = torch.arange(side * side).reshape(side, side)
    corner, right, below, across = (part.reshape(-1) for part in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    faces = torch.stack([torch.stack([corner, right, across], dim=1), torch.stack([corner, across, below], dim=1)], dim=1)
    return vertices, faces.reshape(-1, 3)
