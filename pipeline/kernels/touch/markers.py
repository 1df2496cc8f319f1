"""Dots printed on a gel: where its surface carries them, and how they look."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pipeline.entries import Entries
from pipeline.kernels.arrays import WHITE, Array
from pipeline.kernels.compiled import compiled

Level = Annotated[int, Field(ge=0, le=WHITE)]
ROUNDS = 5  # of the search for what a pixel shows: 0.01 pixels are left of 8 where displacements change by 0.4 per unit of length
BOX = 2.0  # radii from a moved dot's middle within which it is drawn: a stretched dot fits


class MarkerGrid(Entries):
    """Dots printed on an elastic gel, in rows and columns that are spread over it evenly, as those of pixels are."""

    rows: Annotated[int, Field(ge=1, le=1000, description="of dots, along +y")]
    cols: Annotated[int, Field(ge=1, le=1000, description="of dots, along +x")]
    radius: Annotated[float, Field(ge=1e-6, le=0.1, description="of a dot, m")]
    colour: Annotated[tuple[Level, Level, Level], Field(description="red, green, blue, 0 to 255; by default black")] = (0, 0, 0)

    def check_spacing(self, width: float, height: float) -> None:
        """Raise a `ValueError` if the dots overlap on a gel of some size, or one is larger than the gel."""
        least = min(width / self.cols, height / self.rows)
        if 2 * self.radius > least:
            raise ValueError(f"markers of radius {self.radius} m do not fit: each has {least:.3g} m; make them smaller or fewer")

    def positions(self, width: float, height: float) -> Array:  # (rows · cols, 2) m from the gel's middle, row by row
        """Compute the positions of the dots of a gel at rest."""
        x = ((np.arange(self.cols) + 0.5) / self.cols - 0.5) * width
        y = ((np.arange(self.rows) + 0.5) / self.rows - 0.5) * height
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def dot_displacement(
    positions: Array,  # (N, 2) of dots at rest, m from the gel's middle
    displacement: Array,  # (rows, cols, 2) of the gel's surface, m
    pitch: tuple[float, float],  # size of a pixel along y and x, m
) -> Array:  # (N, 2) m
    """Interpolate the displacement of dots between the middles of pixels; beyond the outermost, it is theirs."""
    surface = np.ascontiguousarray(displacement)
    return np.array([_displacement_at(surface, x, y, *pitch) for x, y in positions]).reshape(positions.shape)


@compiled
def draw_dots(
    image: NDArray[np.uint8],  # (rows, cols, 3), changed in place
    displacement: Array,  # (rows, cols, 2) of the gel's surface, m, contiguous
    pitch: tuple[float, float],  # size of a pixel along y and x, m
    positions: Array,  # (N, 2) of dots at rest, m
    radius: float,  # m
    colour: tuple[int, int, int],
) -> None:
    """Draw dots where a gel's surface has carried them: a pixel shows what the surface at x shows at rest, x + displacement = pixel."""
    rows, cols = image.shape[:2]
    size_y, size_x = pitch
    for x0, y0 in positions:
        dx, dy = _displacement_at(displacement, x0, y0, size_y, size_x)
        col, row = (x0 + dx) / size_x + cols / 2 - 0.5, (y0 + dy) / size_y + rows / 2 - 0.5
        reach_x, reach_y = BOX * radius / size_x + 1, BOX * radius / size_y + 1
        for i in range(max(int(np.ceil(row - reach_y)), 0), min(int(row + reach_y), rows - 1) + 1):
            for j in range(max(int(np.ceil(col - reach_x)), 0), min(int(col + reach_x), cols - 1) + 1):
                x, y = (j + 0.5 - cols / 2) * size_x, (i + 0.5 - rows / 2) * size_y
                ux, uy = dx, dy
                for _ in range(ROUNDS):
                    ux, uy = _displacement_at(displacement, x - ux, y - uy, size_y, size_x)
                distance = np.sqrt((x - ux - x0) ** 2 + (y - uy - y0) ** 2)
                share = min(max((radius - distance) / np.sqrt(size_x * size_y) + 0.5, 0.0), 1.0)  # of the pixel
                for channel in range(3):
                    image[i, j, channel] = np.uint8(np.rint(image[i, j, channel] * (1 - share) + colour[channel] * share))


@compiled
def _displacement_at(displacement: Array, x: float, y: float, size_y: float, size_x: float) -> tuple[float, float]:
    """Interpolate linearly at a position, m from the middle."""
    rows, cols = displacement.shape[:2]
    col = min(max(x / size_x + cols / 2 - 0.5, 0.0), cols - 1.0)
    row = min(max(y / size_y + rows / 2 - 0.5, 0.0), rows - 1.0)
    left, top = min(int(col), cols - 2), min(int(row), rows - 2)
    u, v = col - left, row - top
    at = displacement[top : top + 2, left : left + 2]
    ux = (at[0, 0, 0] * (1 - u) + at[0, 1, 0] * u) * (1 - v) + (at[1, 0, 0] * (1 - u) + at[1, 1, 0] * u) * v
    uy = (at[0, 0, 1] * (1 - u) + at[0, 1, 1] * u) * (1 - v) + (at[1, 0, 1] * (1 - u) + at[1, 1, 1] * u) * v
    return ux, uy
