"""Schema of `presses`, from `simulate-presses`: tactile images of shapes that are pressed into a gel without a hand."""

from schemas.base import Array, Artifact, depth_map

PRESSED = ("patch", "ball", "ellipsoid", "cone", "cylinder", "prism", "pyramid", "post", "edge", "ring", "bumps", "stairs", "relief")
"""Pressed shapes; `press_shape` holds indices into this. A patch is one of the object."""

PRESSES = Artifact(
    name="presses",
    stage="simulate-presses",
    order=7,
    version=2,
    summary="Random shapes and patches of each object, pressed into a gel without a hand: to train networks that read photographs.",
    arrays={
        "press_shape": Array(
            "object press", "uint8", "1", f"What was pressed: {', '.join(f'{code} {name}' for code, name in enumerate(PRESSED))}."
        ),
        "press_depth": depth_map("object press"),
        "press_indentation": Array(
            "object press row col", "float32", "m", "How deep the gel's surface lies below its rest, drawn in around the contact too."
        ),
        "press_contact": Array("object press row col", "bool", "1", "Whether the shape touches the gel."),
        "press_pressure": Array("object press row col", "float32", "Pa", "Normal pressure on an elastic gel, 0 elsewhere.", optional=True),
        "press_force": Array("object press", "float32", "N", "Normal force on an elastic gel.", optional=True),
        "press_image": Array("object press row col rgb", "uint8", "1/255", "The tactile image of `press_indentation`."),
        "press_untouched": Array("row col rgb", "uint8", "1/255", "The tactile image when nothing touches the sensor."),
    },
)
