"""Render the overview of a dataset: an object, a grasp, what its sensors measure, and a reconstruction."""

import numpy as np
from numpy.typing import NDArray

from pipeline.contrib.report.reconstruction_gallery import FILL, predicted_mesh, render_mesh
from pipeline.contrib.report.report_source import ReportSource, best, shown_scene
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.drawing.contact_sheet import BandMaker
from pipeline.drawing.contact_sheet_page import depth_colors
from pipeline.drawing.second_view import fitted_camera, grasp_cameras, second_view
from stages.render_vision.renderer import Renderer

PIXELS = 480
"""A picture's side."""

GAP = 4
"""Pixels between the tiles of a picture."""


def overview_panels(
    source: ReportSource,
    object_id: str,
    grasp: int,  # from 0
) -> list[tuple[str, NDArray[np.uint8]]]:  # captions, square images (R, R, 3)
    """Render an object, a grasp of it and its reconstruction, then the steps between.

    These are tactile images, depth maps and touched surface. The reconstruction is the best of those that are given
    touches, else the best of all; there is none if the object was not evaluated.
    """
    rows, sensors, scene = source.rows(object_id), source.sensors(), shown_scene(source.directory)
    mesh = read_mesh(rows["surfaces"])
    camera = fitted_camera(scene.square_camera(PIXELS), mesh.vertices, FILL)
    with Renderer(scene, PIXELS) as renderer:
        maker = BandMaker(renderer, scene=scene, hand=source.hand(), sensors=sensors)
        with maker.grasp_view(rows, grasp) as view:
            grasp_image, touch_image = second_view(renderer, scene, grasp_cameras(renderer, scene, PIXELS, view), view)
        tactile_images, depths = rows["touch"]["tactile_image"][grasp], rows["touch"]["depth"][grasp]
        touches = int(rows["grasps"]["touch_success"][grasp].sum())
        panels = [
            ("object", render_mesh(renderer, mesh, camera)),
            ("grasp", grasp_image),
            ("tactile images →", _grid(list(tactile_images))),
            ("depth maps →", _grid([depth_colors(depth, sensor) for depth, sensor in zip(depths, sensors, strict=True)])),
            (f"touched surface, {touches} touch{'es' * (touches != 1)}", touch_image),
        ]
        if source.evaluation and (predictions := source.evaluation.predictions(object_id)):
            prediction = best([candidate for candidate in predictions if candidate.felt] or predictions)
            predicted = predicted_mesh(
                source.collections.get("charts"), object_id, source.evaluation.tables[prediction.network], prediction.case
            )
            panels.insert(2, (f"reconstruction: {prediction.label}", render_mesh(renderer, predicted, camera)))
    return panels


def _grid(tiles: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Arrange tiles (R, R, 3) of one size in a grid that is as square as possible, with white between them."""
    columns = int(np.ceil(np.sqrt(len(tiles))))
    framed = [np.pad(tile, ((GAP, GAP), (GAP, GAP), (0, 0)), constant_values=255) for tile in tiles]
    framed += [np.full_like(framed[0], 255)] * (-len(framed) % columns)
    return np.concatenate([np.concatenate(framed[start : start + columns], axis=1) for start in range(0, len(framed), columns)])
