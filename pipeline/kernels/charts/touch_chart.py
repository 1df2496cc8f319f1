"""The undeformed touch chart: a square grid of vertices on the sensor plane (supplement 2.3)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

SIDE = 9  # vertices along a side: 81 vertices and 128 faces, the supplement's
MAX_SIDE = 101  # more vertices would be finer than any tactile image resolves


def chart_square(side: int = SIDE, aspect: float = 1.0) -> "tuple[Tensor, Tensor]":  # (side², 3) float64, (2 (side - 1)², 3) int64
    """Make the vertices, sensor widths, and faces of a planar chart as large as a sensor of some height over width, in its plane.

    x goes from -1/2 to 1/2 along a row, y from -aspect/2 to aspect/2 from row to row, as pixels do. Normals are +z. `side` vertices along
    a side, odd: the vertex with index side² // 2 is the centre.
    """
    if side % 2 == 0 or not 3 <= side <= MAX_SIDE:
        raise ValueError(f"side must be odd, 3 to {MAX_SIDE} ({SIDE} in the supplement); it is {side}")
    import torch  # takes a second, which readers of settings save

    along = torch.arange(side, dtype=torch.float64) / (side - 1) - 0.5
    y, x = torch.meshgrid(aspect * along, along, indexing="ij")
    vertices = torch.stack([x, y, torch.zeros_like(x)], dim=-1).reshape(-1, 3)
    index = torch.arange(side * side).reshape(side, side)
    corner, right, below, across = (part.reshape(-1) for part in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    faces = torch.stack([torch.stack([corner, right, across], dim=1), torch.stack([corner, across, below], dim=1)], dim=1)
    return vertices, faces.reshape(-1, 3)


@dataclass(frozen=True)
class FitOptions:
    """Options of a chart's fit. The defaults are fast; the supplement (2.3) has one loss, of all points, for the steps and the halt.

    Where chart and cloud are one surface of area A, their Chamfer distance is still A / (π samples), and as much again from the cloud's own
    density: `halt` must lie above. Fewer `step_samples` and `cloud_points` are faster; the exact loss decides all the same.
    """

    halt: float = 6e-4  # sensor widths², Chamfer distance below which a chart is done
    residual_limit: float | None = None  # sensor widths, greatest RMS distance from cloud to finished chart
    max_iterations: int = 1000  # steps after which a fit ends; 0 leaves the square
    samples: int = 4000  # points of the chart in the Chamfer distance that is compared with `halt`
    step_samples: int = 500  # points of the chart in the loss of a step
    cloud_points: int | None = 500  # points of the cloud in the loss of a step; None is the whole cloud
    check_every: int = 10  # steps between two checks of the exact loss, once it may be below the halt
    learning_rate: float = 1e-2  # Adam's, sensor widths per step
    side: int = SIDE  # vertices along a side of the chart, odd
