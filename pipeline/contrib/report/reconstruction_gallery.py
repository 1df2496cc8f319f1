"""Draw reconstructions beside their objects: a row per object, a column per model, from the dataset's camera."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.contrib.report.report_source import Evaluation, shown_scene
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.touch_charts import is_surface
from pipeline.drawing.plots import save_figure
from pipeline.drawing.second_view import fitted_camera
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.camera import Camera
from pipeline.kernels.vision.scene import Label
from pipeline.reconstruct.mesh_files import TOUCH_COLOR, VISION_COLORS
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory
from schemas.charts import CHARTS
from schemas.surfaces import SURFACES
from stages.evaluate.evaluation_files import Arrays, surface_of
from stages.render_vision.renderer import Renderer

PIXELS = 200
"""A picture's side: enough to see charts."""

FILL = 0.8
"""Share of a picture's side that the object takes up; reconstructions may be larger."""


def nearest_middle_farthest(ranked: Sequence[str], limit: int) -> list[str]:
    """Choose at most `limit` of ranked objects: a third from the beginning, a third from the middle, a third from the end."""
    if len(ranked) <= limit:
        return list(ranked)
    first, middle, last = (len(part) for part in np.array_split(np.arange(limit), 3))
    start = (len(ranked) - middle) // 2
    return [*ranked[:first], *ranked[start : start + middle], *ranked[len(ranked) - last :]]


def draw_gallery(directory: DataDirectory, evaluation: Evaluation, path: Path, object_ids: Sequence[str], names: Sequence[str]) -> None:
    """Draw these models' reconstructions of test objects, each above its mean distance.

    Each model is shown with the fewest and the most grasps that it was given. The camera is the dataset's, turned and zoomed to the object.
    """
    predictions, objects = evaluation.tables, evaluation.object_ids
    surfaces, charts = (directory.collection(artifact) for artifact in (SURFACES, CHARTS))
    columns = [(name, case) for name in names for case in _cases(predictions[name])]
    scene = shown_scene(directory)
    first_camera = scene.square_camera(PIXELS)
    with Renderer(scene, PIXELS) as renderer, matplotlib.rc_context({"font.size": 8}):
        figure = Figure((1.6 * (1 + len(columns)), 1.75 * len(object_ids)), dpi=110, layout="constrained")
        grid = figure.subplots(len(object_ids), 1 + len(columns), squeeze=False)
        for row, object_id in enumerate(object_ids):
            mesh = read_mesh(surfaces.view(object_id))
            camera = fitted_camera(first_camera, mesh.vertices, FILL)
            _show(grid[row, 0], render_mesh(renderer, mesh, camera), object_id if row else f"object\n{object_id}")
            for axes, (name, case) in zip(grid[row, 1:], columns, strict=True):
                grasp_count, first_grasp = (int(predictions[name][key][case]) for key in ("grasps_given", "first_grasp"))
                title = name + (f"\n{grasp_count} grasp{'s' * (grasp_count > 1)}" if grasp_count else "\n")
                error = 1e3 * evaluation.figures[name].per_case("mean_distance", max(grasp_count, 1))[objects.index(object_id), first_grasp]
                mesh = predicted_mesh(charts, object_id, predictions[name], case)
                _show(axes, render_mesh(renderer, mesh, camera), "" if row else title, f"{error:.1f} mm")
        save_figure(figure, path)


def _cases(table: Arrays) -> list[int]:
    """List the cases shown of a model: the fewest grasps it was given, and the most."""
    grasp_counts = table["grasps_given"]
    return sorted({int(np.argmin(grasp_counts)), int(np.argmax(grasp_counts))})


def predicted_mesh(
    fitted: Collection | None,  # the artifact `charts`; None if there are none
    object_id: str,
    table: Arrays,  # the network's group below `predictions` or `meshes`
    case: int,  # number of the choice of grasps
) -> Mesh:
    """Make a mesh of a prediction: in grey, with the touch charts of its input in orange."""
    number = table["object_id"].tolist().index(object_id)
    vertices, faces = ([part] for part in surface_of(table, number, case))
    grasp_count, first_grasp = int(table["grasps_given"][case]), int(table["first_grasp"][case])
    if grasp_count and fitted is not None and "position" in table:  # touch charts are not part of a mesh
        row = fitted.view(object_id)
        charts, touched = row["vertices"], is_surface(row["stop_rule"])  # (grasp, sensor, S, 3), (grasp, sensor)
        grasps = [(first_grasp + step) % len(charts) for step in range(grasp_count)]
        vertices += list(charts[grasps][touched[grasps]])
        faces += [row["chart_faces"]] * (len(vertices) - 1)
    points, triangles = trimesh.util.append_faces(vertices, faces)
    return two_coloured(points, triangles, len(faces[0]))


def two_coloured(vertices: NDArray[np.floating], faces: NDArray[np.integer], grey: int) -> Mesh:
    """Make a mesh of vertices (V, 3), m, and faces (F, 3), of which the first are grey and the others, of touch charts, orange."""
    return painted_mesh(vertices, faces, np.arange(len(faces)) >= grey, [VISION_COLORS[0], TOUCH_COLOR])


def painted_mesh(
    vertices: NDArray[np.floating],  # (V, 3) m
    faces: NDArray[np.integer],  # (F, 3)
    material: NDArray[Any],  # (F,) numbers of colours
    colors: Sequence[tuple[int, ...]],  # RGBA, 0 to 255
) -> Mesh:
    """Make a mesh in plain colours."""
    look = Look(
        uv=np.zeros((len(vertices), 2), np.float32),
        face_material=material.astype(np.int32),
        base_color=np.array(colors, np.uint8),
        material_texture=np.full(len(colors), -1, np.int32),
    )
    return Mesh(vertices.astype(np.float64), faces.astype(np.int32), look)


def render_mesh(renderer: Renderer, mesh: Mesh, camera: Camera | None = None) -> NDArray[np.uint8]:
    """Render a mesh alone, (R, C, 3), with a camera or the renderer's own."""
    with renderer.added(mesh, Label.OBJECT) as handle:
        return renderer.render([(handle, np.eye(4))], camera).rgb


def _show(axes: Axes, image: NDArray[np.uint8], title: str, note: str = "") -> None:
    axes.imshow(image)
    axes.set(xticks=[], yticks=[])
    axes.set_title(title, fontsize=7, loc="left")  # a long name reaches over the next column
    axes.set_xlabel(note, fontsize=7)
