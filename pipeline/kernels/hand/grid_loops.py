"""Compiled loops over an object's distance grid: look-ups, and the clearance of postures, only as exactly as it matters.

All arithmetic on distances is float32, in a fixed order. The loops share a file: numba's cache notices changes of that file only.
"""

from typing import NamedTuple

import numpy as np

from pipeline.kernels.arrays import Array, Array32, Indices, Mask
from pipeline.kernels.compiled import compiled

MILLIMETRE = np.float32(1e-3)
LACK_WEIGHT = np.float32(2)  # value that a posture loses per millimetre of missing clearance
CROSSED_CELLS = np.float32(0.51)  # cells from the surface up to which it may cross a cell, so that its sides differ
BOUND_SLACK_CELLS = np.float32(0.1)  # cells added to a limit, above the rounding of coordinates to float32
FLOOR_SLACK = np.float32(1e-6)  # m below the least gap with which a posture could win, where measuring stops: above rounding


class Grid(NamedTuple):
    """A distance grid."""

    origin: Array32  # (3,) centre of the first cell, m
    scale: np.float32  # cells per metre
    cell: np.float32  # m, side of a cell
    records: Array32  # (X, Y, Z, 4) distance, m, and its gradient


class Spheres(NamedTuple):
    """Spheres in the frames of links."""

    centres: Array32  # (B, 3) m
    radii: Array32  # (B,) m
    link: Indices  # (B,)


@compiled
def _clamp(value: np.float32, top: np.float32) -> np.float32:
    """Clamp a value to 0 … `top`; NaN gives 0."""
    return min(value, top) if value > 0 else np.float32(0)


@compiled
def _nearest_cell(grid: Grid, px: np.float32, py: np.float32, pz: np.float32) -> tuple[Array32, np.float32, np.float32, np.float32]:
    """Find the record of the cell nearest to a point (off the grid, to the nearest on its rim), and the offset from its centre, m."""
    shape = grid.records.shape
    x = _clamp((px - grid.origin[0]) * grid.scale, np.float32(shape[0] - 1))
    y = _clamp((py - grid.origin[1]) * grid.scale, np.float32(shape[1] - 1))
    z = _clamp((pz - grid.origin[2]) * grid.scale, np.float32(shape[2] - 1))
    i, j, k = int(x + np.float32(0.5)), int(y + np.float32(0.5)), int(z + np.float32(0.5))
    dx, dy, dz = (x - np.float32(i)) * grid.cell, (y - np.float32(j)) * grid.cell, (z - np.float32(k)) * grid.cell
    return grid.records[i, j, k], dx, dy, dz


@compiled
def _distance(grid: Grid, px: np.float32, py: np.float32, pz: np.float32) -> np.float32:
    """Compute the distance of a point from the nearest cell's record, to first order."""
    record, dx, dy, dz = _nearest_cell(grid, px, py, pz)
    distance: np.float32 = record[0] + ((record[1] * dx + record[2] * dy) + record[3] * dz)
    return distance


@compiled
def look_up(grid: Grid, points: Array32) -> Array32:
    """Look up the distances (N,) of points (3, N)."""
    distance = np.empty(points.shape[1], np.float32)
    for n in range(len(distance)):
        distance[n] = _distance(grid, points[0, n], points[1, n], points[2, n])
    return distance


@compiled
def near_spheres(
    grid: Grid,
    frames: Array,  # (L, 4, 4) of links, world, m
    centres: Array,  # (B, 3) of spheres in them, m
    radii: Array,  # (B,) m
    link: Indices,  # (B,)
    limit: float,  # m, 0 or more
) -> tuple[Array, Indices]:  # (K, 3) world, m, (K,)
    """Select the spheres whose gap may be below a limit: their centres and numbers.

    A distance changes by no more than its point moves, as long as that does not cross the surface.
    """
    points, selected, count = np.empty(centres.shape), np.empty(len(link), np.intp), 0
    for b in range(len(link)):
        pose, x, y, z = frames[link[b]], centres[b, 0], centres[b, 1], centres[b, 2]
        px = (pose[0, 0] * x + pose[0, 1] * y) + (pose[0, 2] * z + pose[0, 3])
        py = (pose[1, 0] * x + pose[1, 1] * y) + (pose[1, 2] * z + pose[1, 3])
        pz = (pose[2, 0] * x + pose[2, 1] * y) + (pose[2, 2] * z + pose[2, 3])
        record, dx, dy, dz = _nearest_cell(grid, np.float32(px), np.float32(py), np.float32(pz))
        is_outside = record[0] > CROSSED_CELLS * grid.cell
        if not (is_outside and record[0] - np.sqrt(dx * dx + dy * dy + dz * dz) >= limit + radii[b] + BOUND_SLACK_CELLS * grid.cell):
            points[count, 0], points[count, 1], points[count, 2], selected[count] = px, py, pz, b
            count += 1
    return points[:count], selected[:count]


@compiled
def place_probes(frames: Array, link: Indices, grid: Array) -> Array32:  # (3, N, S, P) m
    """Compute where points (S, P, 3) in the frames of links (S,) are, by their frames (N, L, 4, 4)."""
    probes = np.empty((3, len(frames), grid.shape[0], grid.shape[1]), np.float32)
    for n in range(len(frames)):
        for s in range(len(link)):
            for axis in range(3):
                a, b, c, d = frames[n, link[s], axis]
                for p in range(grid.shape[1]):
                    probes[axis, n, s, p] = ((a * grid[s, p, 0] + b * grid[s, p, 1]) + c * grid[s, p, 2]) + d
    return probes


@compiled
def probe_contact(grid: Grid, probes: Array32, pose: Array32) -> tuple[Array32, Array32]:
    """Compute the least distance of each gel's probes (3, N, S, P) at a pose (4, 4), (N, S), and the share that are inside."""
    nearest, share = np.empty(probes.shape[1:3], np.float32), np.empty(probes.shape[1:3], np.float32)
    for n in range(probes.shape[1]):
        for s in range(probes.shape[2]):
            least, inside = np.float32(np.inf), 0
            for p in range(probes.shape[3]):
                x, y, z = probes[0, n, s, p], probes[1, n, s, p], probes[2, n, s, p]
                px = ((pose[0, 0] * x + pose[0, 1] * y) + pose[0, 2] * z) + pose[0, 3]
                py = ((pose[1, 0] * x + pose[1, 1] * y) + pose[1, 2] * z) + pose[1, 3]
                pz = ((pose[2, 0] * x + pose[2, 1] * y) + pose[2, 2] * z) + pose[2, 3]
                distance = _distance(grid, px, py, pz)
                least = min(least, distance)
                inside += int(distance < 0)
            nearest[n, s], share[n, s] = least, np.float32(inside) / np.float32(probes.shape[3])
    return nearest, share


@compiled
def _gap(grid: Grid, frames: Array, spheres: Spheres, floor: np.float32) -> np.float32:
    """Compute the least gap of spheres on link frames (L, 4, 4); if it is below `floor`, any value below `floor`."""
    gap, link, pose = np.float32(np.inf), -1, np.empty((3, 4), np.float32)
    for b in range(len(spheres.link) - 1, -1, -1):  # the fingertip, which comes last, is most often in the way
        if spheres.link[b] != link:
            link = spheres.link[b]
            pose = frames[link, :3].astype(np.float32)
        x, y, z = spheres.centres[b, 0], spheres.centres[b, 1], spheres.centres[b, 2]
        px = (pose[0, 0] * x + pose[0, 1] * y) + (pose[0, 2] * z + pose[0, 3])
        py = (pose[1, 0] * x + pose[1, 1] * y) + (pose[1, 2] * z + pose[1, 3])
        pz = (pose[2, 0] * x + pose[2, 1] * y) + (pose[2, 2] * z + pose[2, 3])
        gap = min(gap, _distance(grid, px, py, pz) - spheres.radii[b])
        if gap < floor:
            break
    return gap


@compiled
def gaps(grid: Grid, frames: Array, spheres: Spheres, floor: np.float32) -> Array32:
    """Compute the least gaps (N,) of spheres on frames (N, L, 4, 4); for one below `floor`, any value below `floor`."""
    return np.array([_gap(grid, frames[n], spheres, floor) for n in range(len(frames))], np.float32)


@compiled
def measure_best(
    grid: Grid,
    frames: Array,  # (N, L, 4, 4)
    spheres: Spheres,  # of one finger
    contact: Array32,  # (N,) values of the postures if nothing is in their way; -inf for unavailable ones
    order: Indices,  # (G, 1 + M) postures of each group: a likely best one, then all by falling `contact`
    best: int,  # postures of greatest value that are requested of each group
    clear: int,  # clear postures that are requested of each group: the first in that order
    clearance: np.float32,  # m; a posture's value falls by what it lacks
) -> tuple[Array32, Mask]:  # (N,), (N,)
    """Measure the clearance of postures where it can decide which have most value, and which are clear.

    Values are exact for the best of each group, smaller or -inf for the others; what is not measured does not count as clear.
    """
    value, is_clear = np.full(len(frames), np.float32(-np.inf)), np.zeros(len(frames), np.bool_)
    top = np.empty(best + 1, np.float32)  # the best values so far, falling; the last is spare
    for group in order:
        top[:] = -np.inf
        if not best:
            top[0] = np.inf
        clear_count = 0
        for n in group:
            threshold = top[max(best - 1, 0)]
            if contact[n] < threshold and clear_count >= clear:
                break  # no later posture can be among the best
            if contact[n] == -np.inf or value[n] > -np.inf:
                continue
            spare = max(contact[n] - threshold, np.float32(0)) / LACK_WEIGHT * MILLIMETRE
            gap = _gap(grid, frames[n], spheres, clearance - spare - FLOOR_SLACK)
            value[n] = contact[n] - LACK_WEIGHT * (max(clearance - gap, np.float32(0)) / MILLIMETRE)
            is_clear[n] = gap >= clearance
            clear_count += int(gap >= clearance)
            rank = best
            while rank > 0 and top[rank - 1] < value[n]:
                top[rank] = top[rank - 1]
                rank -= 1
            if best:
                top[rank] = value[n]
    return value, is_clear
