"""Descriptions of a tactile sensor's optics: lamps (equations 2 to 5), or coefficients that were fitted to photographs."""

from typing import Annotated

from pydantic import Field, model_validator

from pipeline.entries import Entries

Lateral = Annotated[float, Field(ge=-1000, le=1000)]
Position = tuple[Lateral, Lateral, Annotated[float, Field(gt=0, le=1000)]]
Level = Annotated[float, Field(ge=-1e7, le=1e7)]
Levels = tuple[Level, Level, Level]
Box = tuple[float, float, float, float]  # least x and y, greatest x and y, m
Place = Annotated[float, Field(ge=-10, le=10)]

POSITION_TERMS = {(degree + 1) * (degree + 2) // 2: degree for degree in range(7)}  # degree in x and y by number of terms
SLOPE_TERMS = {count - 1: degree for count, degree in POSITION_TERMS.items() if degree}  # in a normal, without a constant


class Lights(Entries):
    """Positions P of the three lamps of equation 5, in sensor widths, along y too, from the corner of pixel (0, 0)."""

    red: Annotated[Position, Field(description="x along columns, y along rows, z out of the gel")]
    green: Annotated[Position, Field(description="as red")]
    blue: Annotated[Position, Field(description="as red")]


class Shadow(Entries):
    """The shadow of one lamp behind a bump of the gel."""

    direction: Annotated[float, Field(ge=-360, le=360, description="towards the lamp, degrees from +x to +y")]
    slope: Annotated[float, Field(gt=0, le=100, description="height over length of the lamp's rays")]
    gain: Annotated[Levels, Field(description="levels of red, green, blue per mm that a point lies in the shade")]


class Calibration(Entries):
    """A model of colours that was fitted to photographs: a polynomial of the gel's normal, whose coefficients depend on the position."""

    coefficients: Annotated[
        tuple[tuple[tuple[Level, ...], ...], ...],
        Field(description="levels by colour, term of the normal (nx, ny, nx², nx ny, …), term of the position (1, x, y, x², x y, …)"),
    ]
    depth: Annotated[
        tuple[tuple[Level, ...], ...] | None,
        Field(
            exclude_if=lambda depth: depth is None,
            description="levels per mm that the gel is pressed in, by colour and term of the position: what is nearer to the camera is lit "
            "differently; by default none",
        ),
    ] = None
    background: Annotated[
        tuple[Levels, ...] | str,
        Field(description="the untouched image: levels by term of the position, or a PNG beside the sensor file"),
    ]
    shadows: Annotated[tuple[Shadow, ...], Field(description="that lamps cast behind bumps of the gel")] = ()
    steepest: Annotated[
        float, Field(gt=0, le=1, description="sine of the steepest slope that was fitted: steeper ones get its colours, none are guessed")
    ] = 1.0
    deepest: Annotated[
        float,
        Field(
            gt=0, le=10, description="depth of the deepest fitted contact, m: deeper ones have its light and shadows; by default no limit"
        ),
    ] = 10.0
    within: Annotated[
        tuple[Place, Place, Place, Place] | None,
        Field(description="part of the gel in which contacts were fitted, m: least x and y, greatest x and y; beyond it, as at its rim"),
    ] = None

    @model_validator(mode="after")
    def _are_polynomials(self) -> "Calibration":
        slopes, positions = {len(color) for color in self.coefficients}, {len(term) for color in self.coefficients for term in color}
        fits = len(slopes) == len(positions) == 1 and slopes <= SLOPE_TERMS.keys() and positions <= POSITION_TERMS.keys()
        if len(self.coefficients) != 3 or not fits:
            have = f"{len(self.coefficients)} colours with {sorted(slopes)} terms of the normal and {sorted(positions)} of the position"
            allowed = f"3, each with one of {list(SLOPE_TERMS)}, each with one of {list(POSITION_TERMS)}"
            raise ValueError(f"coefficients has {have}; there must be {allowed}")
        if self.depth is not None and [len(color) for color in self.depth] != 3 * list(positions):
            have = f"{[len(color) for color in self.depth]} terms of the position by colour"
            raise ValueError(f"depth has {have}; there must be 3 colours, each with as many as coefficients have, {positions.pop()}")
        if not isinstance(self.background, str) and len(self.background) not in POSITION_TERMS:
            raise ValueError(f"background has {len(self.background)} terms of the position; there must be one of {list(POSITION_TERMS)}")
        if self.within is not None and not (self.within[0] < self.within[2] and self.within[1] < self.within[3]):
            raise ValueError(f"within is {list(self.within)}; it must be the least x and y, then the greatest x and y, m")
        return self
