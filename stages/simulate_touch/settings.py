"""The settings of `simulate-touch`."""

from typing import Literal

from pipeline.config.settings import Settings, setting
from pipeline.kernels.touch.sphere_tracing import MAX_STEPS, TOLERANCE


class TouchSettings(Settings):
    """How touches become depth maps and readings (supplement 1.5)."""

    sensor: str = setting(
        "gel_16mm", "the supplement's sensor; another is another file, by name or by path ending in .yaml", changes="definition"
    )
    tracer: Literal["ray", "sphere"] = setting(
        "ray",
        "exact, and tens of times faster than the supplement's `sphere`, which stops `sphere_tolerance` too soon",
    )
    sphere_tolerance: float = setting(
        TOLERANCE,
        "m before the surface at which a sphere-traced ray stops: its error; 1 µm would save a fifth of the time",
        gt=0,
        le=1e-3,
    )
    sphere_steps: int = setting(
        MAX_STEPS,
        "steps after which a sphere-traced ray is intersected exactly; more steps cost time and gain nothing",
        ge=1,
    )
    gel_bits: int | None = setting(
        26,
        "depth in the gel is stored in steps of 2^-26 m: at most 8 nm off, and a fifth fewer bytes; null keeps float32's digits",
        ge=10,
        le=40,
    )
    far_bits: int | None = setting(
        18,
        "depth beyond the gel, which no reading shows: at most 2 µm off, and a fifth fewer bytes",
        ge=10,
        le=40,
    )
    store_points: bool = setting(False, "depth and pose give the points again, bit for bit, and they are three quarters of the bytes")
