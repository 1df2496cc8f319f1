"""The vocabulary of schemas: arrays with dimensions, units and meaning, gathered into versioned artifacts."""

from fnmatch import fnmatchcase
from functools import cached_property
from typing import Annotated, Literal

from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass

from pipeline.entries import Entries

Dtype = Literal["float64", "float32", "int32", "uint8", "bool", "string"]

FIXED = {"xyz": 3, "rgb": 3, "rgba": 4, "xy": 2, "uv": 2, "corner": 3, "pose_row": 4, "pose_column": 4, "image_axis": 3, "homogeneous": 4}
"""Dimensions whose size is the same everywhere; every other size belongs to a dataset, and is the same in all its shards."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Array:
    """One array: its dimensions by name, its type, unit and meaning, and the number of its equation in the paper."""

    dimensions: str  # their names, such as "object grasp xyz"
    dtype: Dtype
    units: str
    description: str
    equation: str | None = None
    infinite: bool = False  # whether +inf is a valid value; NaN never is
    optional: bool = False  # whether some settings leave the array out

    @cached_property
    def dims(self) -> tuple[str, ...]:
        """The names of its dimensions."""
        return tuple(self.dimensions.split())

    @property
    def is_coordinate(self) -> bool:
        """Whether the array labels a dimension; a label that a stage does not give is taken from its inputs."""
        return self in COORDINATES.values()

    @property
    def per_object(self) -> bool:
        """Whether there is one entry per object."""
        return self.dims[:1] == ("object",)


INDEXED_DIMS = ("grasp", "viewpoint", "press", "slide")
"""Second dimensions of which readers take one entry at a time: in large arrays each is a chunk of its own."""

COMMON = {  # arrays that every artifact has
    "object": Array("object", "string", "1", "The object's name, the same in every artifact: the label of its dimension."),
    "object_id": Array("object", "string", "1", "The same names as `object`, called as in records and tables."),
    "category": Array("object", "string", "1", "The object's class."),
    "split": Array("object", "string", "1", "train, valid or test: a label, on which no value depends."),
    "ok": Array("object", "bool", "1", "False where processing failed: its rows are zeros, `failures` in the attributes says why."),
}


class Artifact(Entries):
    """What one stage writes: the arrays of a shard's root group, and those of a group per object where sizes differ.

    `ragged` maps an array's path below the root with the object's id left out, such as `meshes/vertices` for
    `meshes/OBJECT_ID/vertices`; a `*` in it stands for a number.
    """

    name: str
    stage: str = "STAGE"  # that makes it: before it has been made, no record names it, and readers cannot import stages
    order: int = 100  # among the artifacts: readers take a label from the first artifact that has it
    version: int
    summary: str
    arrays: Annotated[dict[str, Array], AfterValidator(lambda arrays: {**COMMON, **arrays})]  # those of `COMMON` among them
    ragged: dict[str, Array] = Field(default_factory=dict)

    def of(self, name: str) -> Array | None:
        """Find the declaration of an array by name or path, ragged ones included; None if there is none."""
        if name in self.arrays:
            return self.arrays[name]
        for pattern, array in self.ragged.items():
            if fnmatchcase(name, pattern):
                return array
        return None


COORDINATES = {  # labels of dimensions: a stage that gives none copies those of its inputs
    "grasp": Array("grasp", "int32", "1", "Number of the grasp, 0 the best.", optional=True),
    "sensor": Array("sensor", "string", "1", "The sensor's name: its finger's, numbered if several, or the hand file's.", optional=True),
    "joint": Array("joint", "string", "1", "Name of the joint in the hand's URDF, finger by finger.", optional=True),
}


def coordinates(*names: str) -> dict[str, Array]:
    """Declare the labels of these dimensions."""
    return {name: COORDINATES[name] for name in names}


def depth_map(dims: str) -> Array:
    """Declare maps of the depths that a sensor measures."""
    meaning = "D: distance from the sensor plane along its normal; +inf where nothing is met within range."
    return Array(f"{dims} row col", "float32", "m", meaning, equation="1", infinite=True)
