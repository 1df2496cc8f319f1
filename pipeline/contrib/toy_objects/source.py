"""The source `procedural`: objects of thirteen classes, modelled from a seed."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from pipeline.config.sources import ModelledSource, Object
from pipeline.contrib.toy_objects import KINDS, generate, maker_module
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.rng import numpy_rng

Category = Literal["bottle", "cellphone", "knife", "rifle", "bowl", "box", "brush", "bulb", "can", "hammer", "mug", "screwdriver", "toy"]


class Procedural(ModelledSource):
    """Objects the project models itself, drawn by seed.

    ```yaml
    - {kind: procedural, licence: MIT, seed: 0, count: {bottle: 20, knife: 5}}
    ```
    """

    kind: Literal["procedural"]
    count: dict[Category, Annotated[int, Field(gt=0)]] = Field(
        min_length=1, description="Of each class; more of them leave the first ones as they are."
    )
    seed: int = Field(ge=0, description="From which their shapes are drawn.")

    def list_objects(self, root: Path | None) -> Iterator[Object]:
        """List every variant of every category."""
        for category, count in self.count.items():
            for number in range(count):
                source = {"kind": self.kind, "category": category, "variant": number, "seed": self.seed, "licence": self.licence}
                yield Object(f"{category}-{number:04d}", category, source)

    @staticmethod
    def mesh(source: Mapping[str, Any]) -> Mesh:
        """Model an object; every kind of its class comes once before any repeats."""
        category, variant, seed = source["category"], source["variant"], source["seed"]
        order = numpy_rng(seed, "procedural", category).permutation(len(KINDS[category]))
        return generate(category, numpy_rng(seed, "procedural", category, variant), order[variant % len(order)])

    @staticmethod
    def identity(source: Mapping[str, Any]) -> str:
        """Name an object by its class, number and seed."""
        return f"procedural {source['category']} {source['variant']}, seed {source['seed']}"

    @staticmethod
    def module(source: Mapping[str, Any]) -> str:
        """Name the module of its class, which imports no other class's module."""
        return maker_module(source["category"])
