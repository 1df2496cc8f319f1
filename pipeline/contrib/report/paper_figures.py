"""Draw the paper's figures from a dataset: the grasp procedure, local points and charts, the sphere of charts, reconstructions."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray
from PIL import Image

from pipeline.contrib.report.reconstruction_gallery import draw_gallery, nearest_middle_farthest, painted_mesh, render_mesh
from pipeline.contrib.report.report_source import ReportSource, shown_scene
from pipeline.dataset.touch_charts import is_surface
from pipeline.drawing.contact_sheet import BandMaker
from pipeline.drawing.contact_sheet_page import COLORS, depth_colors, spread_evenly
from pipeline.drawing.plots import save_figure
from pipeline.drawing.second_view import fitted_camera, grasp_cameras, lamp_beside, second_view
from pipeline.kernels.charts.vision_charts import CHART_VERTICES, VisionCharts, vision_charts
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.pregrasp import pregrasp_angles
from pipeline.kernels.touch.depth_maps import in_gel, local_points
from pipeline.kernels.touch.sensor import masked_points
from pipeline.kernels.vision.scene import Scene
from pipeline.models.touch_model import load_touch_model
from stages.evaluate.settings import SHIPPED_ROWS
from stages.render_vision.renderer import Renderer

PIXELS = 384
"""A rendered picture's side."""

CANDIDATES = 40
"""Objects, spread evenly, among which a figure's object is chosen."""

POINTS = 1500
"""Points of a cloud that are drawn at most."""

OPENING = 0.03
"""m that the fingers are drawn back in the second step's picture: more than in physics, so that it is visible."""

RADIUS = 0.15
"""m, radius of the sphere of charts in its picture."""


def draw_figures(
    source: ReportSource,
    folder: Path,
    max_objects: int,
) -> list[dict[str, Any]]:  # title, text and pictures of each figure
    """Draw the figures that the dataset has data for as PNG files, with at most `max_objects` reconstructions."""
    object_id, grasp = clearest_grasp(source, spread_evenly(source.object_ids, CANDIDATES))
    scene = shown_scene(source.directory)
    with Renderer(scene, PIXELS) as renderer:
        figures = [_procedure(source, renderer, scene, folder, object_id, grasp)]
        charts = source.collections.get("charts")
        if charts and "models/unet" in charts.first.record.models:  # else charts are fitted to points of another network
            figures.append(_local_shape(source, folder, object_id, grasp))
        figures.append(_sphere(renderer, scene, folder, _middle(source, object_id)))
    if source.evaluation:
        names = source.evaluation.configurations
        ours = [name for name in names if not name.startswith(SHIPPED_ROWS)]
        text = (
            "A row per object: those with the least error, then middling ones, then those with the most. A column per network; below each "
            "picture the mean distance to the object. Touch charts are orange."
        )
        for title, file, columns in (
            ("Reconstructions by modality (Figure 5)", "reconstructions.png", ours),
            ("Reconstructions by the network that ships", "reconstructions-shipped.png", [name for name in names if name not in ours]),
        ):
            if columns:
                object_ids = nearest_middle_farthest(source.evaluation.ranked(columns), max_objects)
                draw_gallery(source.directory, source.evaluation, folder / file, object_ids, columns)
                alt = f"Reconstructions of {', '.join(object_ids)}: a row per object, a column per network and number of grasps"
                figures.append(_figure(title, text, [(folder / file, alt, "")], "wide"))
    return figures


def _figure(title: str, text: str, pictures: list[tuple[Path, str, str]], kind: str) -> dict[str, Any]:
    entries = [{"file": f"figures/{path.name}", "alt": alt, "caption": caption} for path, alt, caption in pictures]
    return {"title": title, "text": text, "pictures": entries, "kind": kind}


def clearest_grasp(
    source: ReportSource,
    ids: Sequence[str],  # objects to choose from
    max_grasps: int | None = None,  # only these first ones of each object; None for all
) -> tuple[str, int]:  # the object, and the grasp, from 0
    """Choose an object and a grasp of it with many touches, in whose image object and hand are large."""
    scores = {}
    for object_id in ids:
        rows = source.rows(object_id)
        touches = rows["grasps"]["touch_success"].sum(axis=1)
        segmentations = rows["vision"]["segmentation"][1:, 0] if "vision" in rows else np.ones((len(touches), 1, 1))
        for grasp, touched in enumerate(touches[:max_grasps]):
            areas = [np.count_nonzero(segmentations[grasp] == label) for label in (1, 2)] if len(segmentations) > grasp else [1, 1]
            scores[object_id, grasp] = (int(touched), min(2 * areas[0], areas[1]))
    return max(scores, key=lambda key: scores[key])


def _procedure(source: ReportSource, renderer: Renderer, scene: Scene, folder: Path, object_id: str, grasp: int) -> dict[str, Any]:
    files = []
    for number, (caption, image) in enumerate(procedure_steps(source, renderer, scene, object_id, grasp), start=1):
        path = folder / f"procedure-{number}.png"
        Image.fromarray(image).save(path, optimize=True)
        files.append((path, f"{object_id}, step {number} of its grasp", f"{number}. {caption}"))
    text = f"Grasp {grasp + 1} of {object_id}. Of many such attempts the grasps with most touches are kept."
    return _figure("How a grasp is made (Figure 1)", text, files, "steps")


def procedure_steps(
    source: ReportSource,
    renderer: Renderer,
    scene: Scene,
    object_id: str,
    grasp: int,  # from 0
) -> list[tuple[str, NDArray[np.uint8]]]:  # captions, images (`PIXELS`, `PIXELS`, 3)
    """Render the steps of a grasp: hand, fingers drawn back, fingers closed, touched surface."""
    rows, hand = source.rows(object_id), source.hand()
    pose, angles = rows["grasps"]["hand_pose"][grasp], rows["grasps"]["joint_angles"][grasp]
    postures = [
        ("the palm faces a random point of the surface, fingers stretched", hand.lower),
        (
            "inverse kinematics find a posture at the surface; fingers are drawn back",
            pregrasp_angles(hand, angles, [OPENING])[0],
        ),
        ("in physics the fingers close until contact settles", angles),
    ]
    steps = []
    maker = BandMaker(renderer, scene=scene, hand=hand, sensors=source.sensors())
    with maker.grasp_view(rows, grasp) as view:
        cameras = grasp_cameras(renderer, scene, PIXELS, view)
        for caption, posture in postures:
            frames = forward_kinematics(hand, pose, posture)
            posed_meshes = [(view.object_mesh[0], np.eye(4)), *((shape, frames[link]) for link, shape, _ in maker.shapes)]
            steps.append((caption, renderer.render(posed_meshes, cameras[0], lamp_beside(scene, cameras[0])).rgb))
        touched = second_view(renderer, scene, cameras, view)[1]
        steps.append(("each sensor measures the surface in its gel (coloured)", touched))
    return steps


def _local_shape(source: ReportSource, folder: Path, object_id: str, grasp: int) -> dict[str, Any]:
    """Draw predicted beside true depth, points and charts of a grasp's touches."""
    rows, sensors = source.rows(object_id), source.sensors()
    model = load_touch_model(source.directory.verified_folder("models/unet"), "cpu")
    touched = np.flatnonzero(rows["grasps"]["touch_success"][grasp])
    tactile_images, depths = rows["touch"]["tactile_image"][grasp][touched], rows["touch"]["depth"][grasp][touched]
    predicted, pressed = model.maps(tactile_images)
    clouds = [masked_points(*maps, model.sensor) for maps in zip(predicted, pressed, strict=True)]
    names = [mount.name for mount in source.hand().sensors]
    path = folder / "local-shape.png"
    with matplotlib.rc_context({"font.size": 8}):
        layout = ConstrainedLayoutEngine(rect=(0.02, 0, 0.94, 1))  # it ignores the width of labels beside 3D axes
        figure = Figure((9, 2.3 * len(touched)), dpi=110, layout=layout)
        grid = figure.add_gridspec(len(touched), 4)
        for row, number in enumerate(touched.tolist()):
            pose, sensor = rows["grasps"]["sensor_pose"][grasp, number], sensors[number]
            true, count = local_points(depths[row], pose, sensor)
            inside = in_gel(depths[row], sensor)
            error = np.abs(np.where(inside, predicted[row] - depths[row], 0))
            pictures = [
                ("tactile image", tactile_images[row]),
                ("true depth", depth_colors(depths[row], sensor)),
                ("predicted depth", depth_colors(np.where(pressed[row], predicted[row], np.inf), sensor)),
            ]
            for column, (title, image) in enumerate(pictures):
                axes = figure.add_subplot(grid[row, column])
                half_width, half_height = 500 * sensor.width, 500 * sensor.height  # mm
                axes.imshow(image, extent=(-half_width, half_width, half_height, -half_height))
                axes.set(title=title if row == 0 else "", ylabel=f"{names[number]}: y, mm" if column == 0 else "", xlabel="x, mm")
            figure.colorbar(ScalarMappable(Normalize(0, 1e3 * sensor.w), "viridis_r"), ax=axes, shrink=0.8, label="depth, mm")
            axes.set_xlabel(f"x, mm; mean error {1e3 * error[inside].mean():.2f} mm")
            axes = figure.add_subplot(grid[row, 3], projection="3d")
            draw_local_points(axes, rows, true[:count], clouds[row], grasp, number)
        save_figure(figure, path)
    text = (
        "Per touch: what the sensor sees, the depth it has, the depth the U-Net predicts from the image, and in 3D the true local points "
        "(blue), the predicted ones (orange) and the chart fitted to them (wire)."
    )
    alt = f"Tactile images, true and predicted depth maps, and local points of {len(touched)} touches of {object_id}"
    return _figure("Local points and touch charts, predicted and true (Figure 3)", text, [(path, alt, "")], "wide")


def draw_local_points(
    axes: Any,  # 3D
    rows: Any,  # the object's, of grasps and charts
    true: NDArray[Any],  # (N, 3) world, m
    cloud: NDArray[Any],  # (M, 3) predicted, sensor frame, m
    grasp: int,  # from 0
    sensor: int,  # from 0
) -> None:
    """Draw true points, predicted points and the chart of a touch, in the sensor's frame, mm."""
    to_sensor = np.linalg.inv(rows["grasps"]["sensor_pose"][grasp, sensor])
    for points, color in ((_local(true, to_sensor), COLORS[0]), (1e3 * cloud, COLORS[1])):
        axes.scatter(*points[:: max(1, len(points) // POINTS)].T, s=0.6, color=tuple(channel / 255 for channel in color))
    charts = rows["charts"]
    if is_surface(charts["stop_rule"][grasp, sensor]):
        local = _local(charts["vertices"][grasp, sensor], to_sensor)
        axes.plot_trisurf(*local.T, triangles=charts["chart_faces"], color=(0, 0, 0, 0), edgecolor=(0, 0, 0, 0.35), linewidth=0.3)
    axes.set_xlabel("x, mm", labelpad=-8)
    axes.set_ylabel("y, mm", labelpad=-8)
    axes.set_zlabel("depth, mm", labelpad=-6)
    axes.set_box_aspect(None, zoom=0.8)  # else the label is outside the figure
    axes.locator_params(nbins=4)
    axes.tick_params(labelsize=6, pad=-3)
    axes.view_init(elev=35, azim=-60)


def _local(points: NDArray[Any], to_sensor: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(1e3 * (points @ to_sensor[:3, :3].T + to_sensor[:3, 3]))


def _middle(source: ReportSource, object_id: str) -> NDArray[np.float64]:
    points = source.rows(object_id)["surfaces"]["points"]
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2, np.float64)


def _sphere(renderer: Renderer, scene: Scene, folder: Path, middle: NDArray[np.float64]) -> dict[str, Any]:
    """Draw the sphere of vision charts before any deformation, neighbouring charts in different colours."""
    charts = vision_charts()
    camera = fitted_camera(scene.square_camera(PIXELS), 1.4 * RADIUS * charts.vertices + middle)
    pictures = []
    for number, (gap, caption) in enumerate(((1.0, "closed: vertices at the seams coincide"), (1.25, "the charts drawn apart"))):
        chart = np.arange(len(charts.vertices)) // CHART_VERTICES
        offset = (gap - 1) * charts.vertices[charts.centres][chart]
        mesh = colored_charts(charts, RADIUS * (charts.vertices + offset) + middle)
        path = folder / f"sphere-{number + 1}.png"
        Image.fromarray(render_mesh(renderer, mesh, camera)).save(path, optimize=True)
        pictures.append((path, f"Sphere of {len(charts.centres)} charts, {caption}", caption))
    text = f"The {len(charts.centres)} vision charts, {len(charts.vertices)} vertices, that the graph network deforms."
    return _figure("The sphere of vision charts (Figure 4)", text, pictures, "steps")


def colored_charts(charts: VisionCharts, vertices: NDArray[np.float64]) -> Mesh:
    """Make a mesh of vision charts whose vertices (V, 3), m, may have moved; neighbouring charts have different colours."""
    return painted_mesh(vertices, charts.faces, charts.faces[:, 0] // CHART_VERTICES % len(COLORS), [(*color, 255) for color in COLORS])
