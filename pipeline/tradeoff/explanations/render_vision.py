"""What `render-vision` left out: images not asked for, the hand where there is none, looks that repeat, texels no image shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Inputs
from pipeline.engine.unit import Unit
from pipeline.formats.hand_file import load_hand
from pipeline.kernels.vision.primitives import faces_by_material, shrink_texture
from pipeline.tradeoff.explain import Count
from stages.render_vision.settings import VisionSettings


def explain(settings: VisionSettings, models: Mapping[str, Path], units: Sequence[tuple[Unit, Inputs]]) -> Iterator[Count]:
    """Count images, hand shapes and looks of these objects."""
    shapes = len(load_hand(str(settings.hand)).visual_meshes)
    for _, inputs in units:
        grasps = len(inputs["grasps"]["hand_pose"])
        held = grasps if settings.occluded else 0
        yield Count("images", 1 + held, grasps - held, "`occluded` is off: no image with a hand is asked for")
        yield Count("hand shapes drawn", shapes * held, shapes * (1 + grasps - held), "no hand is in these images")
        look = read_mesh(inputs["surfaces"]).look
        drawn = len(faces_by_material(look))
        yield Count("materials drawn", drawn, len(look.base_color) - drawn, "they look like another one, and are drawn with it")
        texels = sum(texture.shape[0] * texture.shape[1] for texture in look.textures)
        kept = sum(small.shape[0] * small.shape[1] for small in map(shrink_texture, look.textures))
        yield Count("texels", kept, texels - kept, "finer than any image of this size shows")
