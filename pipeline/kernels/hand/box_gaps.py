"""Gaps between boxes: compiled loops, which share a file because numba's cache notices changes of a function's own file only."""

import numpy as np

from pipeline.kernels.arrays import Array, Indices, Mask
from pipeline.kernels.compiled import compiled

PARALLEL_SINE2 = 1e-6  # squared sine below which edges are parallel: their cross product is no axis, those of faces do


@compiled
def box_gap(
    frame_a: Array,  # (4, 4) pose of the box's centre, m
    half_a: Array,  # (3,) half extents, m
    frame_b: Array,
    half_b: Array,
    enough: float = np.inf,  # m, a gap as good as any larger one: the search ends there
) -> float:  # m; a lower bound of the distance of boxes that are apart; of boxes that overlap, minus their least overlap
    """Compute the largest gap between two boxes along any of the 15 candidate axes."""
    rotation, size, shift = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    gap = -np.inf
    x, y, z = frame_b[0, 3] - frame_a[0, 3], frame_b[1, 3] - frame_a[1, 3], frame_b[2, 3] - frame_a[2, 3]
    for i in range(3):  # the axes of a
        for k in range(3):
            rotation[i, k] = frame_a[0, i] * frame_b[0, k] + frame_a[1, i] * frame_b[1, k] + frame_a[2, i] * frame_b[2, k]
            size[i, k] = abs(rotation[i, k])
        shift[i] = frame_a[0, i] * x + frame_a[1, i] * y + frame_a[2, i] * z
        gap = max(gap, abs(shift[i]) - half_a[i] - (size[i, 0] * half_b[0] + size[i, 1] * half_b[1] + size[i, 2] * half_b[2]))
    if gap >= enough:
        return gap
    for k in range(3):  # the axes of b
        along = abs(rotation[0, k] * shift[0] + rotation[1, k] * shift[1] + rotation[2, k] * shift[2])
        gap = max(gap, along - half_b[k] - (size[0, k] * half_a[0] + size[1, k] * half_a[1] + size[2, k] * half_a[2]))
    if gap >= enough:
        return gap
    for i in range(3):  # the cross products of two
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            sine2 = 1 - rotation[i, k] ** 2
            if sine2 > PARALLEL_SINE2:
                k1, k2 = (k + 1) % 3, (k + 2) % 3
                distance = abs(shift[i2] * rotation[i1, k] - shift[i1] * rotation[i2, k])
                extent = half_a[i1] * size[i2, k] + half_a[i2] * size[i1, k]
                extent = extent + half_b[k1] * size[i, k2] + half_b[k2] * size[i, k1]
                gap = max(gap, (distance - extent) / np.sqrt(sine2))
    return gap


@compiled
def least_gap(world: Array, half: Array, first: Indices, second: Indices) -> float:
    """Compute the least gap, m, of pairs of boxes (C, 4, 4) with half extents (C, 3); inf without pairs."""
    gap = np.inf
    for a, b in zip(first, second):  # noqa: B905 - numba knows no `strict`
        gap = min(gap, box_gap(world[a], half[a], world[b], half[b], gap))
    return gap


@compiled
def are_near(world: Array, half: Array, first: Indices, second: Indices, gap: float) -> Mask:
    """Find the pairs of boxes (N, C, 4, 4) that are nearer than `gap`, (N, pairs)."""
    near = np.empty((len(world), len(first)), np.bool_)
    for n in range(len(world)):
        for pair in range(len(first)):
            a, b = first[pair], second[pair]
            near[n, pair] = box_gap(world[n, a], half[a], world[n, b], half[b], gap) < gap
    return near


@compiled
def conflicts(
    world: Array,  # (O, C, 4, 4) frames of boxes
    half: Array,  # (C, 3) half extents
    first: Indices,  # (pairs,) of boxes that may not touch
    second: Indices,
    owner: Indices,  # (C,) finger of each box, -1 for none
    fingers: int,
    gap: float,
) -> Mask:  # (F, F, O, O)
    """Find where finger a in option i is too near finger b in option j; filled for a < b."""
    options = len(world)
    conflicts = np.zeros((fingers, fingers, options, options), np.bool_)
    radius = np.sqrt(half[:, 0] ** 2 + half[:, 1] ** 2 + half[:, 2] ** 2)
    for pair in range(len(first)):
        k, m = first[pair], second[pair]
        if owner[k] > owner[m]:
            k, m = m, k
        if owner[k] < 0 or owner[k] == owner[m]:
            continue
        reach = radius[k] + radius[m] + gap
        pair_conflicts = conflicts[owner[k], owner[m]]
        for i in range(options):
            for j in range(options):
                if not pair_conflicts[i, j]:
                    a, b = world[i, k], world[j, m]
                    x, y, z = a[0, 3] - b[0, 3], a[1, 3] - b[1, 3], a[2, 3] - b[2, 3]
                    if np.sqrt(x * x + y * y + z * z) < reach:
                        pair_conflicts[i, j] = box_gap(a, half[k], b, half[m], gap) < gap
    return conflicts
