"""The model of a toy object: parts and their materials, joined to one mesh; colours."""

from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from pipeline.contrib.toy_objects.solids import Color, Material, Solid
from pipeline.kernels.geometry.mesh import Look, Mesh

Palette = tuple[Color, ...]
Option = TypeVar("Option")
MILLIMETRE = 1e-3  # makers work in millimetres, meshes are in metres

WHITE, BLACK, RED, GOLD = (246, 246, 246), (30, 30, 34), (196, 36, 38), (196, 156, 72)
WOODS: Palette = ((112, 66, 36), (146, 94, 52), (78, 46, 30), (176, 124, 76), (56, 38, 32))
PLASTICS: Palette = ((228, 228, 224), (206, 58, 48), (44, 104, 180), (236, 174, 44), (80, 148, 84), (224, 110, 150))
GLAZES: Palette = (*PLASTICS, WHITE, WHITE, (70, 90, 120), (120, 60, 44), (190, 178, 150), (60, 70, 60))
STEELS: Palette = ((206, 210, 214), (184, 190, 196), (222, 222, 220), (150, 156, 162))


class Stretch(NamedTuple):
    """A stretch of a finished model between two positions, by a factor from a range."""

    axes: str
    low: float
    high: float
    start: float = -inf
    end: float = inf


class Model:
    """An object in the making: the generator that all of it is drawn from, and its solids in millimetres.

    A class of objects is a subclass, whose `kinds` each draw an object.
    """

    kinds: ClassVar[tuple[Callable[[Any], None], ...]]
    proportions: ClassVar[tuple[Stretch, ...]]

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.uniform = rng, rng.uniform
        self.solids: list[Solid] = []  # the first paint of each is its own material

    def integers(self, low: int, high: int) -> int:
        """Draw an integer from `low` to before `high`."""
        return int(self.rng.integers(low, high))

    def one_of(self, *options: Option) -> Option:
        """Draw one of some options."""
        return options[self.rng.integers(len(options))]

    def chance(self, share: float) -> bool:
        """Draw True with a probability of `share`."""
        return bool(self.rng.random() < share)

    def pick(self, *colors: Color) -> Material:
        """Draw a material of one of the colours, lighter or darker by up to 12, each channel off by up to 4."""
        shift = self.rng.integers(-12, 13) + self.rng.integers(-4, 5, 3)
        r, g, b = (np.array(self.one_of(*colors)) + shift).clip(0, 255).tolist()
        return Material((r, g, b))

    def add(self, material: Material | Palette, *solids: Solid) -> None:
        """Add parts of one material, drawn if colours are given, under what is painted over them."""
        if not isinstance(material, Material):
            material = self.pick(*material)
        self.solids += [replace(solid, paints=(material, *solid.paints)) for solid in solids]

    def stretch(self, axes: str, start: float, end: float, factor: float) -> None:
        """Scale what lies between two positions along each of some axes; what lies beyond them shifts."""
        for solid in self.solids:
            for axis in axes:
                along = solid.vertices[:, "xyz".index(axis)]
                along += (factor - 1.0) * (along.clip(start, end) - np.clip(0.0, start, end))

    def mesh(self) -> Mesh:
        """Join the parts to a mesh in metres, turned so that what was modelled to face -y faces +x.

        Positions are rounded to 0.1 µm and texture coordinates to 1e-6: sines and powers differ between processors in their last
        bits, meshes must not.
        """
        materials = list(dict.fromkeys(material for solid in self.solids for material in solid.paints))
        textures = {material: material.image for material in materials if material.image is not None}
        starts = np.cumsum([0] + [len(solid.vertices) for solid in self.solids[:-1]])
        numbers = [np.array([materials.index(m) for m in solid.paints])[solid.layer] for solid in self.solids]
        look = Look(
            uv=(np.concatenate([solid.uv for solid in self.solids]).clip(0.0, 1.0).round(6) + 0.0).astype(np.float32),
            face_material=np.concatenate(numbers).astype(np.int32),
            base_color=np.array([[*material.color, 255] for material in materials], np.uint8),
            material_texture=np.array([list(textures).index(m) if m in textures else -1 for m in materials], np.int32),
            textures=tuple(textures.values()),
        )
        faces = np.concatenate([solid.faces + start for solid, start in zip(self.solids, starts, strict=True)])
        x, y, z = np.concatenate([solid.vertices for solid in self.solids]).round(4).T * MILLIMETRE
        turned = np.stack([-y, x, z], axis=1) + 0.0  # no negative zeros
        return Mesh(turned, faces.astype(np.int32), look)
