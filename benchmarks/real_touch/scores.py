"""Score depth and contact that were read in a photograph against the truth."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from benchmarks.real_touch.photograph_sets import ANNOTATED, Press, distances

WALL = 0.3
"""mm from the rim of a flat face in which normals are not compared: the gel cannot follow a wall."""


@dataclass(frozen=True, eq=False)
class Reading:
    """What a method reads in a photograph: (rows, cols) depth, mm, and whether a pixel touches; None where it does not say."""

    depth: NDArray[np.float64]
    contact: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Scores:
    """Errors of a reading."""

    rmse: float  # root of the mean squared depth error over the footprint, mm; NaN where the truth is a shape without depth
    bias: float  # mean error, mm; likewise
    shape: float  # the RMSE after the mean error is taken away, mm
    sphere: float  # mean angle between normals, degrees, on balls
    flat: float  # on flat faces
    overlap: float  # intersection over union with the press's contact, else its footprint; NaN where a method does not say


def score(reading: Reading, press: Press, scale: float) -> Scores:
    """Compare a reading with a press; `scale` is mm per pixel."""
    error = (reading.depth - press.depth)[press.footprint]
    bias = float(error.mean()) if press.absolute else np.nan
    rmse = float(np.sqrt(np.square(error).mean())) if press.absolute else np.nan
    compared = press.footprint
    if press.flat:
        compared = binary_erosion(press.footprint, iterations=round(WALL / scale))
    angle = float(np.degrees(angles(reading.depth, press.depth, scale)[compared]).mean())
    overlap = np.nan
    if reading.contact is not None:
        overlap = float((reading.contact & press.touched).sum() / (reading.contact | press.touched).sum())
    by_kind = (np.nan, angle) if press.flat else (angle, np.nan)
    return Scores(rmse, bias, float(error.std()), *by_kind, overlap)


def angles(depth: NDArray[np.float64], truth: NDArray[np.float64], scale: float | tuple[float, float]) -> NDArray[np.float64]:
    """Compute the angle between the normals of two depth maps at each pixel, rad; `scale` is mm per pixel, perhaps along y and x."""
    one, other = (np.stack([*np.gradient(surface, *np.broadcast_to(scale, 2)), np.ones_like(surface)]) for surface in (depth, truth))
    product = (one * other).sum(axis=0) / np.linalg.norm(one, axis=0) / np.linalg.norm(other, axis=0)
    return np.arccos(np.clip(product, -1, 1))


def ball_footprint(reading: Reading, press: Press) -> NDArray[np.bool_]:
    """Choose the pixels for recovering a ball's radius: a disc in the contact that the method reads, else the press's footprint."""
    if reading.contact is None or not reading.contact.any():
        return press.footprint
    row, col = np.nonzero(reading.contact)
    reach = ANNOTATED * np.sqrt(len(row) / np.pi)
    return np.asarray(reading.contact & (distances(reading.contact.shape, col.mean(), row.mean()) < reach))


def ball_radius(depth: NDArray[np.float64], footprint: NDArray[np.bool_], scale: float | tuple[float, float]) -> float:
    """Find the radius of the sphere nearest to the depth (rows, cols), mm, in a footprint; `scale` as in `angles`."""
    pitch_y, pitch_x = np.broadcast_to(scale, 2)
    row, col = np.nonzero(footprint)
    points = np.stack([pitch_x * col, pitch_y * row, depth[footprint]], axis=1)
    points -= points.mean(axis=0)
    solved = np.linalg.lstsq(np.column_stack([2 * points, np.ones(len(points))]), np.square(points).sum(axis=1), rcond=None)[0]
    return float(np.sqrt(solved[3] + np.square(solved[:3]).sum()))


def mean_scores(scores: list[Scores]) -> Scores:
    """Average scores, each over the presses that have it."""
    columns = np.array([[getattr(press_scores, field.name) for field in fields(Scores)] for press_scores in scores])
    defined = ~np.isnan(columns)
    sums = np.where(defined, columns, 0).sum(axis=0)
    return Scores(*np.where(defined.any(axis=0), sums / np.maximum(defined.sum(axis=0), 1), np.nan).tolist())
