"""Parts and their materials, put together to one mesh."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.toy_objects.shapes import Solid

Color = tuple[int, int, int]
MILLIMETRE = 1e-3  # the recipes are written in millimetres, meshes in metres


@dataclass(frozen=True, eq=False)
class Material:
    """One base colour (sRGB), perhaps a texture image (height, width, 4) uint8 that it multiplies."""

    color: Color
    image: NDArray[np.uint8] | None = None


@dataclass
class Model:
    """An object in the making: solids in millimetres, each with its material."""

    parts: list[tuple[Solid, Material]] = field(default_factory=list)

    def add(self, material: Material, *solids: Solid) -> None:
        """Add parts of one material."""
        self.parts.extend((solid, material) for solid in solids)

    def mesh(self) -> Mesh:
        """All parts as one mesh in metres, turned so that what was modelled to face -y faces +x; parts share no vertex."""
        materials = list(dict.fromkeys(material for _, material in self.parts))
        images = [m.image for m in materials if m.image is not None]
        worn = np.cumsum([m.image is not None for m in materials]) - 1
        starts = np.cumsum([0] + [len(solid.vertices) for solid, _ in self.parts[:-1]])
        rows = [np.full(len(solid.faces), materials.index(material)) for solid, material in self.parts]
        look = Look(
            uv=np.concatenate([solid.uv for solid, _ in self.parts]).clip(0.0, 1.0).astype(np.float32),
            face_material=np.concatenate(rows).astype(np.int32),
            base_color=np.array([[*m.color, 255] for m in materials], np.uint8),
            material_texture=np.where([m.image is not None for m in materials], worn, -1).astype(np.int32),
            textures=tuple(images),
        )
        faces = [solid.faces + start for (solid, _), start in zip(self.parts, starts, strict=True)]
        vertices = np.concatenate([solid.vertices for solid, _ in self.parts]) * MILLIMETRE
        turned = np.stack([-vertices[:, 1], vertices[:, 0], vertices[:, 2]], axis=1)
        return Mesh(turned, np.concatenate(faces).astype(np.int32), look)


def pick(rng: np.random.Generator, *colors: Color, spread: int = 12) -> Material:
    """A material of one of the colours, lighter or darker by up to `spread`, each channel off by a third of that."""
    hue = spread // 3
    shift = rng.integers(-spread, spread + 1) + rng.integers(-hue, hue + 1, 3)
    r, g, b = (np.array(colors[rng.integers(len(colors))]) + shift).clip(0, 255).tolist()
    return Material((r, g, b))


def chance(rng: np.random.Generator, share: float) -> bool:
    """True in `share` of the draws."""
    return bool(rng.random() < share)
