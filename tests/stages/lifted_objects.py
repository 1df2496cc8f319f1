"""A small real dataset of lifts: a grasp each of two modelled objects, on coarse elastic gels."""

from pathlib import Path

from pipeline.formats.description_file import description_path
from tests.stages.tiny_dataset import manifest, run_stage

STEPS, RATE = 8, 16.0


def coarse_gel(folder: Path, friction: float | None = 0.8) -> Path:
    """Write the file of a sensor of 20 × 20 pixels with an elastic gel."""
    text = description_path("sensor", "gel_16mm").read_text().replace("rows: 100", "rows: 20").replace("cols: 100", "cols: 20")
    path = folder / "coarse.yaml"
    path.write_text(text + f"gel: {{modulus: 1e5, poisson: 0.48{'' if friction is None else f', friction: {friction}'}}}\n")
    return path


def lift_assignments(sensor: Path) -> tuple[str, ...]:
    """Return the settings of the stages."""
    touch = ("sequence=lift", f"lift_steps={STEPS}", f"lift_rate={RATE:g}")
    return (f"simulate-grasps.sensor={sensor}", "simulate-grasps.grasps=1", *(f"simulate-touch.{text}" for text in touch))


def make_lifts(folder: Path, *more: str) -> None:
    """Make the dataset."""
    assignments = (*lift_assignments(coarse_gel(folder)), *more)
    for stage in ("sample-surfaces", "simulate-grasps", "simulate-touch"):
        run_stage(folder, stage, manifest(), *assignments)
