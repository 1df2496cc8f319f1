"""Parts and their materials, put together to one mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.toy_objects.solids import Solid

Rng = np.random.Generator
Color = tuple[int, int, int]
Palette = tuple[Color, ...]
MILLIMETRE = 1e-3  # makers work in millimetres, meshes are in metres


@dataclass(frozen=True, eq=False)
class Material:
    """One base colour (sRGB), perhaps a texture image (height, width, 4) uint8 that it multiplies."""

    color: Color
    image: NDArray[np.uint8] | None = None


@dataclass
class Model:
    """An object in the making: solids in millimetres, each with one material per layer."""

    parts: list[tuple[tuple[Material, ...], Solid]] = field(default_factory=list)

    def add(self, material: Material | tuple[Material, ...], *solids: Solid) -> None:
        """Add parts of one material, or of several: one per layer."""
        materials = material if isinstance(material, tuple) else (material,)
        self.parts.extend((materials, solid) for solid in solids)

    def mesh(self) -> Mesh:
        """Join the parts to a mesh in metres, turned so that what was modelled to face -y faces +x.

        Positions are rounded to 0.1 µm and texture coordinates to 1e-6: sines and powers differ between processors in their last
        bits, meshes must not.
        """
        materials = list(dict.fromkeys(material for layers, _ in self.parts for material in layers))
        textured = [material for material in materials if material.image is not None]
        starts = np.cumsum([0] + [len(solid.vertices) for _, solid in self.parts[:-1]])
        numbers = [np.array([materials.index(m) for m in layers])[solid.layer] for layers, solid in self.parts]
        look = Look(
            uv=(np.concatenate([solid.uv for _, solid in self.parts]).clip(0.0, 1.0).round(6) + 0.0).astype(np.float32),
            face_material=np.concatenate(numbers).astype(np.int32),
            base_color=np.array([[*material.color, 255] for material in materials], np.uint8),
            material_texture=np.array([textured.index(m) if m in textured else -1 for m in materials], np.int32),
            textures=tuple(material.image for material in textured if material.image is not None),
        )
        faces = np.concatenate([solid.faces + start for (_, solid), start in zip(self.parts, starts, strict=True)])
        x, y, z = np.concatenate([solid.vertices for _, solid in self.parts]).round(4).T * MILLIMETRE
        turned = np.stack([-y, x, z], axis=1) + 0.0  # no negative zeros
        return Mesh(turned, faces.astype(np.int32), look)


Kind = Callable[[Model, Rng], None]
"""Draws one kind of object from the rng and adds its parts to a model."""


def pick(rng: Rng, *colors: Color, spread: int = 12) -> Material:
    """Draw a material of one of the colours, lighter or darker by up to `spread`, each channel off by a third of that."""
    shift = rng.integers(-spread, spread + 1) + rng.integers(-(spread // 3), spread // 3 + 1, 3)
    r, g, b = (np.array(colors[rng.integers(len(colors))]) + shift).clip(0, 255).tolist()
    return Material((r, g, b))


def chance(rng: Rng, share: float) -> bool:
    """Draw True with a probability of `share`."""
    return bool(rng.random() < share)
