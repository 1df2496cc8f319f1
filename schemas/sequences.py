"""The arrays of touches over time: what `pipeline.kernels.touch.sliding` measures in each step, under the same names."""

from collections.abc import Collection
from dataclasses import replace

from schemas.base import Array, depth_map

SEQUENCES = {"slide": "slides", "lift": "touch"}  # kinds of sequences, the prefixes of their arrays, and the artifacts that hold them
ALWAYS = ("time", "pose", "settled")  # quantities that no setting leaves out


def over_time(
    prefix: str,
    dims: str,  # the last is that of the steps
    always: Collection[str] = (),  # quantities that are in every dataset
) -> dict[str, Array]:
    """Declare the arrays of touches over time as PREFIX_QUANTITY.

    Components are along x and y of the sensor frame; forces and tractions are the object's on the gel.
    """
    arrays = {
        "time": Array(dims, "float32", "s", "Time of the step since the first."),
        "pose": Array(f"{dims} pose_row pose_column", "float64", "m", "Sensor frame to the frame of the object."),
        "depth": depth_map(dims),
        "tactile_image": Array(
            f"{dims} row col rgb", "uint8", "1/255", "R: the tactile image of the gel, with the sensor's markers as its surface moves them."
        ),
        "pressure": Array(f"{dims} row col", "float32", "Pa", "Normal pressure, to 12 binary digits; 0 outside the contact."),
        "shear": Array(f"{dims} row col xy", "float32", "m", "Displacement of the gel's surface from its rest, in multiples of 2^-22 m."),
        "traction": Array(f"{dims} row col xy", "float32", "Pa", "Tangential traction, at most friction times pressure; 12 binary digits."),
        "slip": Array(f"{dims} row col xy", "float32", "m", "How far the object slid in the step, to 12 binary digits; 0 if it sticks."),
        "slip_share": Array(dims, "float32", "1", "Share of the contact that slips; 0 without contact."),
        "gross_slip": Array(dims, "bool", "1", "Whether the object touches and sticks nowhere."),
        "force": Array(f"{dims} xyz", "float32", "N", "Force on the gel, sensor frame; z points out of it: a press is negative."),
        "torque": Array(dims, "float32", "N m", "Torque of the tractions about the sensor's axis, +z."),
        "marker_displacement": Array(
            f"{dims} marker xy", "float32", "m", "How far the gel's surface has moved the sensor's markers, row by row of their grid."
        ),
        "settled": Array(dims, "bool", "1", "Whether the friction settled; if not, do not rely on the step's shear, slip and forces."),
    }
    return {f"{prefix}_{name}": replace(array, optional=name not in always) for name, array in arrays.items()}
