"""The output of `measure-press`: how deep each touch presses in."""

from schemas.base import Array, Artifact, coordinates

PRESS = Artifact(
    name="press",
    stage="measure-press",
    version=1,
    summary="How deep each touch presses into the gel.",
    arrays={**coordinates("grasp", "sensor"), "press": Array("object grasp sensor", "float32", "m", "Greatest depth in the gel.")},
)
