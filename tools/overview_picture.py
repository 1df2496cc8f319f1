"""Draw the README's picture: what `vt-pipeline demo` is given of a held object, and what it makes of it.

    python -m tools.overview_picture data/demo docs/overview.png

The demo's files go to `data/demo`.
"""

import sys
from pathlib import Path

import numpy as np
from PIL.Image import Resampling
from PIL.Image import open as open_image

from pipeline.console import console
from pipeline.contrib.report.figures import FILL, overview_panels
from pipeline.contrib.report.report_source import ReportSource
from pipeline.drawing.views import fitted_camera, render_mesh
from pipeline.reconstruct.demo import Demo, demo
from stages.render_vision.renderer import Renderer
from tools.picture_row import draw_row

PIXELS = 480  # per side of each picture


def draw_overview(shown: Demo, path: Path) -> None:
    """Draw the image and the touches of a demo, and below them the grasp, the reconstructions and the object, as a PNG."""
    source = ReportSource(shown.data)
    scene, (object_id,) = source.scene(), source.object_ids
    real, held, tactile, depth, touched = (image for _, image in overview_panels(source, object_id, 0, PIXELS))
    with open_image(shown.image) as image:
        seen = np.asarray(image.resize((PIXELS, PIXELS), Resampling.BICUBIC))
    camera = fitted_camera(scene.square_camera(PIXELS), shown.truth.vertices, FILL)
    with Renderer(scene, PIXELS) as renderer:
        of_image, of_touch = (render_mesh(renderer, made.mesh, camera) for made in (shown.from_image, shown.from_touch))
    in_mm = [f"{1e3 * made.distance:.1f} mm from it" for made in (shown.from_image, shown.from_touch)]
    panels = [
        ("what the camera sees", seen),
        ("what the gels see", tactile),
        ("how deep it is in them", depth),
        ("where they touch", touched),
        ("the grasp, from another side", held),
        (f"from the image alone:\n{in_mm[0]}", of_image),
        (f"from image and touch:\n{in_mm[1]}", of_touch),
        ("the object", real),
    ]
    draw_row(panels, path, columns=4, inches=2.6)


if __name__ == "__main__":
    draw_overview(demo(Path(sys.argv[1]), console), Path(sys.argv[2]))
