"""Picture three procedural objects of each class: `python -m tools.class_picture docs/pictures/classes.webp`."""

import sys
from pathlib import Path

from pipeline.contrib.toy_objects.source import MAKERS, generate
from pipeline.drawing.views import fitted_camera, render_mesh
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.geometry.mesh_cleaning import normalise_mesh
from pipeline.rng import numpy_rng
from stages.render_vision.renderer import Renderer
from tools.picture_row import Panel, draw_row

PIXELS, EACH = 128, 3
"""Of each object's picture; objects of each class."""


def picture_classes(path: Path) -> None:
    """Draw a column per class, as the supplement's camera sees its objects, cut to fill the picture."""
    scene = load_scene("supplement")
    panels: list[tuple[str, Panel]] = []
    with Renderer(scene, PIXELS) as renderer:
        for number in range(EACH):
            for category in MAKERS:
                mesh, _ = normalise_mesh(generate(category, numpy_rng(number, category), 4 * number), up="z", diagonal=0.5)
                camera = fitted_camera(scene.square_camera(PIXELS), mesh.vertices)
                panels.append(("" if number else category, render_mesh(renderer, mesh, camera)))
    draw_row(panels, path, len(MAKERS), inches=0.9)


if __name__ == "__main__":
    picture_classes(Path(sys.argv[1]))
