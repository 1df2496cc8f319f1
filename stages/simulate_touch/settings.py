"""The settings of `simulate-touch`."""

from typing import Annotated, Literal

from pipeline.config.settings import ObjectSettings, described_by, setting
from pipeline.kernels.touch.sphere_tracing import TOLERANCE


class TouchSettings(ObjectSettings):
    """How depth maps and tactile images are simulated (supplement 1.5)."""

    sensors: tuple[Annotated[str, described_by("sensor")], ...] | None = setting(
        None, "null follows the grasps: the sensor that each finger of the hand wore", changes="definition"
    )
    tracer: Literal["ray", "sphere"] = setting(
        "ray",
        "exact, and about a hundred times faster than the supplement's `sphere`, which stops `sphere_tolerance` before the surface",
    )
    sphere_tolerance: float = setting(
        TOLERANCE,
        "greatest distance before the surface at which a sphere-traced ray stops, m; 1 µm would save a fifth of the time",
        ge=1e-9,
        le=1e-3,
    )
    gel_bits: int | None = setting(
        26,
        "depth in the gel is stored in steps of 2^-26 m: error at most 8 nm, a fifth fewer bytes; null keeps float32's precision. Half a "
        "step is below the 0.1 mm by which a successful touch enters the gel",
        ge=13,
        le=40,
    )
    far_bits: int | None = setting(
        18,
        "depth beyond the gel, which no tactile image shows: error at most 2 µm, a fifth fewer bytes",
        ge=10,
        le=40,
    )
    store_points: bool = setting(False, "local points follow from depth and pose bit for bit, and would be three quarters of the bytes")
