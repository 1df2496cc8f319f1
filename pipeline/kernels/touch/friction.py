"""Coulomb friction between a rigid object that moves and an elastic gel: traction, displacement of its surface, stick and slip.

Valid range: that of `elastic_contact`, and displacements that are small beside the contact. Friction does not change the pressure. One
coefficient holds for stick and slip, at any speed. Components are along x and y of the sensor frame.
"""

from typing import NamedTuple

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Array32, Floats, Mask
from pipeline.kernels.compiled import compiled
from pipeline.kernels.geometry.transforms import compose, invert_pose
from pipeline.kernels.touch.depth_maps import gel_surface
from pipeline.kernels.touch.elastic_contact import PressedGel, cell_means, contact_cells, refine
from pipeline.kernels.touch.sensor import Gel, Sensor, pixel_centres
from pipeline.kernels.touch.shear_layer import ShearConvolution, shear_displacement, shear_stiffness

FRICTIONLESS = 1e-9  # coefficient below which there is no traction
TOLERANCE = 1e-4  # of displacements in the contact, root mean square, over the largest: the force errs by as much
MAX_STEPS = 100  # of the solver: almost three times the most that any of 3120 random steps has needed
RIM = np.float32(1 - 1e-6)  # share of the square of the greatest traction from which a cell is at its limit
SLIP = 1e-3  # share of the object's motion by which a cell slips at least: cells at their limit need not slide
BLOCK = 8  # cells by whose multiples the windows of contacts grow: so that few sizes are prepared


class FrictionState(NamedTuple):
    """What friction has done to a gel, on its `contact_cells`: the result of a step, and the start of the next."""

    traction: Array  # (2, rows, cols) of the object on the gel, Pa
    displacement: Array  # (2, rows, cols) of the gel's surface from its rest, m
    anchor: Array  # (2, rows, cols) the displacement that the surface keeps where it sticks, m
    slip: Array  # (2, rows, cols) by which the object slid over the surface in the step, m; 0 where it sticks and outside the contact
    contact: Mask  # (rows, cols)
    settled: bool = True  # False if the solver ended before it reached its tolerance


def gel_at_rest(sensor: Sensor) -> FrictionState:
    """Make the state of a gel that nothing has sheared."""
    factor, _ = contact_cells(sensor)
    shape = (-(-sensor.rows // factor), -(-sensor.cols // factor))
    traction, displacement, anchor, slip = np.zeros((4, 2, *shape))
    return FrictionState(traction, displacement, anchor, slip, np.zeros(shape, bool))


def object_motion(
    depth: Floats,  # (rows, cols) now, m
    before: Array,  # (4, 4) pose of the sensor in the object's frame, m
    now: Array,  # (4, 4)
    sensor: Sensor,
) -> Array:  # (3, rows, cols of cells) sensor frame, m
    """Compute how far the points of an object that now lie over the cells of a gel have moved; in the gel's surface where none does."""
    factor, _ = contact_cells(sensor)
    x, y = (centres[::factor] + (factor - 1) / 2 * size for centres, size in zip(pixel_centres(sensor), sensor.pitch[::-1], strict=True))
    surface = np.broadcast_to(gel_surface(sensor), sensor.shape)
    height = surface[::factor, ::factor] - cell_means(np.maximum(surface - depth, 0.0), factor)
    points = np.stack([*np.broadcast_arrays(x[None], y[:, None]), height])
    back = np.eye(4) - compose(invert_pose(before), now)
    return np.stack([row[3] + (row[0] * points[0] + row[1] * points[1] + row[2] * points[2]) for row in back[:3]])


def drag_gel(
    pressed: PressedGel,  # by the object now
    motion: Array,  # (3, rows, cols of cells) of the object since the state before, m
    before: FrictionState,
    sensor: Sensor,
    friction: float,  # coefficient
) -> FrictionState:
    """Move an object that an elastic gel is pressed by, for one step (Kalker, Three-Dimensional Elastic Bodies in Rolling Contact, 1990).

    Where the surface sticks, it is displaced by the anchor and the motion. The traction q, |q| <= friction · pressure, minimises
    q·Aq/2 - q·(displacement where all sticks - displacement by the pressure), A being `shear_influence`. Cells outside the contact are
    anchored where the surface is. A motion of more than the gel's thickness while they touch is `InvalidInput`.
    """
    factor, pitch = contact_cells(sensor)
    assert isinstance(sensor.gel, Gel)
    stiff = sensor.gel.modulus / (1 - sensor.gel.poisson**2)
    pressure = cell_means(np.asarray(pressed.pressure), factor) / stiff
    contact, along = pressure > 0, motion[:2]
    farthest, thickness = _longest(motion[:, contact | before.contact]), sensor.layer_thickness
    if farthest > thickness:
        raise InvalidInput(
            f"the object moves by {farthest:.3g} m over the gel of sensor {sensor.name!r} in one step, more than the gel's thickness, "
            f"{thickness:.3g} m: add poses in between"
        )
    if not contact.any():
        return gel_at_rest(sensor)
    layer, window, stuck = (pitch, sensor.gel.poisson, thickness), _window(contact), before.anchor + along
    friction = friction if friction >= FRICTIONLESS else 0.0
    bound = friction * pressure[window[1:]]
    traction, settled, local = np.zeros_like(stuck), True, shear_displacement(bound.shape, contact.shape, layer)
    if friction > 0:
        target = stuck[window] - local(traction[window], pressure[window[1:]])
        traction[window], settled = _solve(target, bound, before.traction[window] / stiff, local, shear_stiffness(bound.shape, layer))
    displacement = shear_displacement(contact.shape, contact.shape, layer)(traction, pressure).astype(np.float64)
    sticks = contact & (np.square(traction).sum(axis=0) < RIM * np.square(friction * pressure))
    slip = np.where(contact & ~sticks, stuck - displacement, 0.0)
    least = max(SLIP * _longest(along[:, contact]), TOLERANCE * _longest(displacement))
    slip[:, np.hypot(*slip) <= least] = 0
    return FrictionState(traction * stiff, displacement, np.where(sticks, stuck, displacement), slip, contact, settled)


def surface_displacement(state: FrictionState, sensor: Sensor) -> Array:  # (rows, cols, 2) m
    """Interpolate the displacement of a gel's surface between the middles of cells."""
    factor, _ = contact_cells(sensor)
    return np.stack([part if factor == 1 else refine(part, factor, sensor.shape) for part in state.displacement], axis=-1)


def surface_traction(state: FrictionState, pressed: PressedGel, sensor: Sensor) -> Array:  # (rows, cols, 2) Pa
    """Spread the traction of cells over their pixels as their pressure is: the ratio of both is that of the cell."""
    fine = np.asarray(pressed.pressure)
    pressure = cell_means(fine, contact_cells(sensor)[0])
    ratio = np.divide(state.traction, pressure, out=np.zeros_like(state.traction), where=pressure > 0)
    return np.asarray(on_pixels(ratio, sensor) * fine[..., None])


def force_and_torque(traction: Array, sensor: Sensor) -> tuple[Array, float]:  # (2,) N; N m
    """Add up the traction (rows, cols, 2), Pa, on a sensor's gel, and its torque about the sensor's axis, +z."""
    x, y = pixel_centres(sensor)
    moments = x[None] * traction[..., 1] - y[:, None] * traction[..., 0]
    return np.asarray(traction.sum(axis=(0, 1)) * np.prod(sensor.pitch)), float(moments.sum() * np.prod(sensor.pitch))


def on_pixels(cells: Array, sensor: Sensor) -> Array:  # (rows, cols, 2)
    """Give pixels the value of their cell, of (2, rows, cols of cells)."""
    factor, _ = contact_cells(sensor)
    return np.moveaxis(cells.repeat(factor, axis=1).repeat(factor, axis=2), 0, -1)[: sensor.rows, : sensor.cols]


def _longest(vectors: Array) -> float:
    """Compute the greatest length of vectors (n, ...)."""
    return float(np.sqrt(np.square(vectors).sum(axis=0).max(initial=0.0)))


def _window(contact: Mask) -> tuple[slice, slice, slice]:
    """Find the window of a contact; the first slice is of both components."""
    slices = []
    for axis in (1, 0):
        at, count = np.flatnonzero(contact.any(axis=axis)), contact.shape[1 - axis]
        size = min(-(-(at[-1] - at[0] + 1) // BLOCK) * BLOCK, count)
        start = min(at[0], count - size)
        slices.append(slice(start, start + size))
    return slice(None), slices[0], slices[1]


def _solve(target: Array, bound: Array, start: Array, local: ShearConvolution, stiffness: ShearConvolution) -> tuple[Array, bool]:
    """Find the traction (2, rows, cols) and whether it settled: by preconditioned conjugate gradients on discs of radii `bound`.

    Cells on the rim of their disc that the gap pushes outwards slip: they move along the rim, whose curvature adds to the stiffness.
    """
    unit = bound.max()  # single precision holds small coefficients too
    radius, target, traction = ((array / unit).astype(np.float32) for array in (bound, target, start))
    normal, residual, direction = np.zeros((3, *target.shape), np.float32)
    curvature, contact, small = np.zeros(radius.shape, np.float32), radius > 0, np.float32(1 / local.size)
    traction = _clip(traction, radius)
    moved = local(traction)
    size, decrease = np.abs(moved).max(), 1.0
    traction = _clip(traction - small * (moved - target), radius)  # else cells that slip far would be taken for sticking
    for _ in range(MAX_STEPS):
        moved = local(traction)
        size, gap = max(size, np.abs(moved).max()), (moved - target) * contact
        if _find_slip(traction, gap, radius, small, normal, curvature) <= TOLERANCE * size:
            return traction * np.float64(unit), True
        before, residual = residual, _along_rims(gap, normal)
        weight = contact / np.sqrt(1 + curvature * stiffness.size)
        step = _along_rims(weight * stiffness(weight * residual), normal)
        last, decrease = decrease, _dot(step, residual)
        direction = step + np.float32(max(0.0, (decrease - _dot(step, before)) / last)) * _along_rims(direction, normal)
        yielding = local(direction)
        length = np.float32(_dot(residual, direction) / _dot(direction, yielding + curvature * direction))
        traction = _clip(traction - length * direction, radius, normal.any(axis=0))
    return traction * np.float64(unit), False


def _dot(one: Array32, other: Array32) -> float:
    return float((one * other).sum(dtype=np.float64))


@compiled
def _find_slip(traction: Array32, gap: Floats, radius: Array32, small: np.float32, normal: Array32, curvature: Array32) -> float:
    """Set the normal and curvature of the rims along which cells slip, 0 for the other cells.

    Return the root mean square of what a small step along the gap changes, over that step: 0 for the solution.
    """
    squares, cells = 0.0, 0
    for row in range(radius.shape[0]):
        for col in range(radius.shape[1]):
            limit = radius[row, col]
            if limit == 0:
                continue
            x, y, gap_x, gap_y = traction[0, row, col], traction[1, row, col], gap[0, row, col], gap[1, row, col]
            step_x, step_y = x - small * gap_x, y - small * gap_y
            length = np.sqrt(step_x * step_x + step_y * step_y)
            share = limit / length if length > limit else np.float32(1)
            squares += (x - step_x * share) ** 2 + (y - step_y * share) ** 2
            cells += 1
            outwards = -(gap_x * x + gap_y * y) / limit
            slips = outwards >= 0 and x * x + y * y >= limit * limit * RIM
            normal[0, row, col] = x / limit if slips else np.float32(0)
            normal[1, row, col] = y / limit if slips else np.float32(0)
            curvature[row, col] = outwards / limit if slips else np.float32(0)
    return float(np.sqrt(squares / max(cells, 1)) / small)


def _along_rims(vectors: Array32, normal: Array32) -> Array32:  # (2, rows, cols)
    """Take away the part of vectors (2, rows, cols) along normals, which are 0 where nothing slips."""
    return np.asarray(vectors - (vectors * normal).sum(axis=0) * normal)


def _clip(traction: Floats, radius: Array32, slips: Mask | bool = False) -> Array32:  # (2, rows, cols)
    """Shorten tractions to the radius of their disc; those that slip get its length."""
    length = np.sqrt(np.square(traction).sum(axis=0))
    return np.asarray(traction * np.divide(radius, length, out=np.ones_like(length), where=(length > radius) | (slips & (length > 0))))
