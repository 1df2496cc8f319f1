"""Schema of `slides`, from `simulate-slides`: touches over time of shapes and patches that slide over a gel."""

from schemas.base import Array, Artifact
from schemas.presses import PRESSED
from schemas.sequences import ALWAYS, over_time

SLIDES = Artifact(
    name="slides",
    stage="simulate-slides",
    order=8,
    version=1,
    summary="Random shapes and patches of each object that are pressed into a gel, slid, twisted and lifted off: shear, slip and forces.",
    arrays={
        "slide_shape": Array(
            "object slide", "uint8", "1", f"What was pressed: {', '.join(f'{code} {name}' for code, name in enumerate(PRESSED))}."
        ),
        "slide_scale": Array("object slide", "float32", "1", "Scale of the object whose patch was pressed, and of its frame; 1 of shapes."),
        "slide_friction": Array("object slide", "float32", "1", "Coefficient of friction."),
        **over_time("slide", "object slide step", always=ALWAYS),
        "slide_untouched": Array("row col rgb", "uint8", "1/255", "The tactile image when nothing touches the sensor."),
    },
)
