"""The model of a toy object: parts and their materials, joined to one mesh; colours."""

from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.contrib.toy_objects.solids import Color, Material, Solid
from pipeline.kernels.geometry.mesh import Look, Mesh

Rng = np.random.Generator
Palette = tuple[Color, ...]
MILLIMETRE = 1e-3  # makers work in millimetres, meshes are in metres

WHITE, BLACK, RED, GOLD = (246, 246, 246), (30, 30, 34), (196, 36, 38), (196, 156, 72)
WOODS: Palette = ((112, 66, 36), (146, 94, 52), (78, 46, 30), (176, 124, 76), (56, 38, 32))
PLASTICS: Palette = ((228, 228, 224), (206, 58, 48), (44, 104, 180), (236, 174, 44), (80, 148, 84), (224, 110, 150))
GLAZES: Palette = (*PLASTICS, WHITE, WHITE, (70, 90, 120), (120, 60, 44), (190, 178, 150), (60, 70, 60))
STEELS: Palette = ((206, 210, 214), (184, 190, 196), (222, 222, 220), (150, 156, 162))


@dataclass
class Model:
    """An object in the making: solids in millimetres, the first paint of each its own material."""

    solids: list[Solid] = field(default_factory=list)

    def add(self, material: Material, *solids: Solid) -> None:
        """Add parts of one material, under what is painted over them."""
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


def pick(rng: Rng, *colors: Color, spread: int = 12) -> Material:
    """Draw a material of one of the colours, lighter or darker by up to `spread`, each channel off by a third of that."""
    shift = rng.integers(-spread, spread + 1) + rng.integers(-(spread // 3), spread // 3 + 1, 3)
    r, g, b = (np.array(colors[rng.integers(len(colors))]) + shift).clip(0, 255).tolist()
    return Material((r, g, b))


def chance(rng: Rng, share: float) -> bool:
    """Draw True with a probability of `share`."""
    return bool(rng.random() < share)
