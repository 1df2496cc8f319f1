"""Draw the paper's figures from a dataset: the grasp procedure, local points and charts, the sphere of charts, reconstructions."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray
from PIL.Image import fromarray
from skimage.util import montage

from pipeline.console import pluralise
from pipeline.contrib.report.report_source import Picture, ReportSource, best, painted_mesh
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import is_surface
from pipeline.drawing.colors import COLORS, depth_colors
from pipeline.drawing.grasp_pictures import GraspPictures, touches_of
from pipeline.drawing.picture_sheet import SheetRow, Tile, draw_sheet, spread_evenly
from pipeline.drawing.plots import save_figure
from pipeline.drawing.views import fitted_camera, render_mesh
from pipeline.kernels.charts.vision_charts import CHART_VERTICES, VisionCharts, vision_charts
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.pregrasp import pregrasp_angles
from pipeline.kernels.touch.depth_maps import in_gel, local_points
from pipeline.kernels.touch.sensor import masked_points
from pipeline.kernels.vision.scene import Label
from pipeline.models.touch_model import load_touch_model
from stages.evaluate.evaluation_files import SHIPPED_ROWS
from stages.render_vision.renderer import Renderer

PIXELS = 384  # a rendered picture's side
CANDIDATES = 40  # objects, spread evenly, among which a figure's object is chosen
POINTS = 1500  # points of a cloud that are drawn at most
OPENING = 0.03
"""m that the fingers are drawn back in the second step's picture: more than in physics, so that it is visible."""
RADIUS = 0.15  # m, radius of the sphere of charts in its picture
FILL = 0.8  # share of a picture's side that an object takes up beside its reconstructions, which may be larger
GRID: Any = {"fill": (255, 255, 255), "padding_width": 4, "channel_axis": 3}  # white between tiles
Image = NDArray[np.uint8]  # (rows, cols, 3)


class PaperFigure(NamedTuple):
    """A figure of the paper, drawn from the dataset."""

    title: str
    text: str
    pictures: list[Picture]
    kind: str = "wide"  # or steps: narrow pictures in a row


def draw_figures(source: ReportSource, folder: Path, max_objects: int) -> list[PaperFigure]:
    """Draw the figures that the dataset has data for as PNG files, with at most `max_objects` reconstructions."""
    object_id, grasp = clearest_grasp(source, spread_evenly(source.object_ids, CANDIDATES))
    scene = source.scene()
    with Renderer(scene, PIXELS) as renderer:
        figures = [_procedure(source, renderer, folder, object_id, grasp)]
        charts = source.collections.get("charts")
        if charts and "models/unet" in charts.first.record.models:  # else charts are fitted to points of another network
            figures.append(_local_shape(source, folder, object_id, grasp))
        figures.append(_sphere(source, renderer, folder, object_id))
    if source.evaluation:
        names = source.evaluation.configurations
        ours = [name for name in names if not name.startswith(SHIPPED_ROWS)]
        text = (
            "A row per object: those with the least error, then middling ones, then those with the most. Below each reconstruction is its "
            "mean distance to the object. Touch charts are orange."
        )
        for title, file, columns in (
            ("Reconstructions by modality (Figure 5)", "reconstructions.png", ours),
            ("Reconstructions by the pretrained network", "reconstructions-shipped.png", [name for name in names if name not in ours]),
        ):
            if columns:
                object_ids = nearest_middle_farthest(source.evaluation.ranked(columns), max_objects)
                draw_gallery(source, folder / file, object_ids, columns)
                alt = f"Reconstructions of {', '.join(object_ids)}: a row per object, a column per network and number of grasps"
                figures.append(PaperFigure(title, text, [Picture(f"figures/{file}", alt)]))
    return figures


def save_picture(image: Image, folder: Path, name: str, alt: str, caption: str = "") -> Picture:
    """Write an image of a page into the folder `figures` of a report."""
    fromarray(image).save(folder / name, optimize=True, quality=85)
    return Picture(f"figures/{name}", alt, caption)


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
            areas = (
                [np.count_nonzero(segmentations[grasp] == label) for label in (Label.OBJECT, Label.HAND)]
                if len(segmentations) > grasp
                else [1, 1]
            )
            scores[object_id, grasp] = (int(touched), min(2 * areas[0], areas[1]))
    return max(scores, key=lambda key: scores[key])


def overview_panels(
    source: ReportSource,
    object_id: str,
    grasp: int,  # from 0
    pixels: int = 480,
) -> list[tuple[str, Image]]:  # captions, square images
    """Render an object, a grasp of it and its reconstruction, then the tactile images, depth maps and touched surface between.

    The reconstruction is the best of those that are given touches, else the best of all; there is none if the object was not evaluated.
    """
    rows, sensors, scene, hand = source.rows(object_id), source.sensors(), source.scene(), source.hand()
    mesh, touches = read_mesh(rows["surfaces"]), touches_of(rows, grasp, hand, sensors)
    camera = fitted_camera(scene.square_camera(pixels), mesh.vertices, FILL)
    count = sum(touch.touched for touch in touches)
    with Renderer(scene, pixels) as renderer:
        with GraspPictures(renderer, scene, hand, sensors).second_side(rows, grasp, pixels) as side:
            held, touched = side.held(), side.touched()
        panels = [
            ("object", render_mesh(renderer, mesh, camera)),
            ("grasp", held),
            ("tactile images →", montage([touch.tactile_image for touch in touches], **GRID)),
            ("depth maps →", montage([touch.depth for touch in touches], **GRID)),
            (f"touched surface, {pluralise(count, 'touch')}", touched),
        ]
        if source.evaluation and (predictions := source.evaluation.predictions(object_id)):
            prediction = best([candidate for candidate in predictions if candidate.felt] or predictions)
            predicted = source.evaluation.mesh(object_id, prediction)
            panels.insert(2, (f"reconstruction: {prediction.inputs}, {prediction.error}", render_mesh(renderer, predicted, camera)))
    return panels


def nearest_middle_farthest(ranked: Sequence[str], limit: int) -> list[str]:
    """Choose at most `limit` of ranked objects: a third from the beginning, a third from the middle, a third from the end."""
    if len(ranked) <= limit:
        return list(ranked)
    first, middle, last = (len(part) for part in np.array_split(np.arange(limit), 3))
    start = (len(ranked) - middle) // 2
    return [*ranked[:first], *ranked[start : start + middle], *ranked[len(ranked) - last :]]


def draw_gallery(source: ReportSource, path: Path, object_ids: Sequence[str], names: Sequence[str], pixels: int = 200) -> None:
    """Draw these networks' reconstructions of test objects beside the objects, each from the fewest and the most grasps it was given."""
    evaluation, scene, sheet_rows = source.evaluation, source.scene(), []
    assert evaluation is not None
    with Renderer(scene, pixels) as renderer:
        for object_id in object_ids:
            mesh = read_mesh(source.collections["surfaces"].view(object_id))
            camera = fitted_camera(scene.square_camera(pixels), mesh.vertices, FILL)
            tiles = [Tile("object", [render_mesh(renderer, mesh, camera)])]
            for name in names:
                predictions = [prediction for prediction in evaluation.predictions(object_id) if prediction.network == name]
                for prediction in {prediction.grasps: prediction for prediction in (predictions[0], predictions[-1])}.values():
                    predicted = evaluation.mesh(object_id, prediction)
                    tiles.append(Tile(prediction.inputs, [render_mesh(renderer, predicted, camera)], prediction.error))
            sheet_rows.append(SheetRow(object_id, "", tiles))
    draw_sheet(sheet_rows, path, title="Reconstructions", note="below each: mean distance to the object", page=len(sheet_rows))


def _procedure(source: ReportSource, renderer: Renderer, folder: Path, object_id: str, grasp: int) -> PaperFigure:
    pictures = [
        save_picture(image, folder, f"procedure-{number}.png", f"{object_id}, step {number} of its grasp", f"{number}. {caption}")
        for number, (caption, image) in enumerate(procedure_steps(source, renderer, object_id, grasp), start=1)
    ]
    text = f"Grasp {grasp + 1} of {object_id}. Of many such attempts the grasps with most touches are kept."
    return PaperFigure("How a grasp is made (Figure 1)", text, pictures, "steps")


def procedure_steps(
    source: ReportSource,
    renderer: Renderer,
    object_id: str,
    grasp: int,  # from 0
) -> list[tuple[str, Image]]:  # captions, images (`PIXELS`, `PIXELS`, 3)
    """Render the steps of a grasp: hand, fingers drawn back, fingers closed, touched surface."""
    rows, hand = source.rows(object_id), source.hand()
    angles = rows["grasps"]["joint_angles"][grasp]
    postures = (
        ("the palm faces a random point of the surface, fingers stretched", hand.lower),
        ("inverse kinematics find a posture at the surface; fingers are drawn back", pregrasp_angles(hand, angles, [OPENING])[0]),
        ("in physics the fingers close until contact settles", angles),
    )
    with GraspPictures(renderer, source.scene(), hand, source.sensors()).second_side(rows, grasp, PIXELS) as side:
        steps = [(caption, side.posture(posture)) for caption, posture in postures]
        return [*steps, ("each sensor measures the surface in its gel (coloured)", side.touched())]


def _local_shape(source: ReportSource, folder: Path, object_id: str, grasp: int) -> PaperFigure:
    """Draw predicted beside true depth, points and charts of a grasp's touches."""
    rows, sensors = source.rows(object_id), source.sensors()
    model = load_touch_model(source.directory.verified_folder("models/unet"), "cpu")
    touched = np.flatnonzero(rows["grasps"]["touch_success"][grasp])
    depths = rows["touch"]["depth"][grasp][touched]
    predicted, pressed = model.maps(rows["touch"]["tactile_image"][grasp][touched])
    clouds = [masked_points(*maps, model.sensor) for maps in zip(predicted, pressed, strict=True)]
    touches = touches_of(rows, grasp, source.hand(), sensors)
    with matplotlib.rc_context({"font.size": 8}):
        layout = ConstrainedLayoutEngine(rect=(0.02, 0, 0.94, 1))  # it ignores the width of labels beside 3D axes
        figure = Figure((9, 2.3 * len(touched)), dpi=110, layout=layout)
        grid = figure.add_gridspec(len(touched), 4)
        for row, number in enumerate(touched.tolist()):
            sensor, touch, depth = sensors[number], touches[number], predicted[row]
            true, count = local_points(depths[row], rows["grasps"]["sensor_pose"][grasp, number], sensor)
            inside = in_gel(depths[row], sensor)
            error = np.abs(depth[inside] - depths[row][inside]).mean()
            read = depth_colors(np.where(pressed[row], depth, np.inf), sensor)
            pictures = {"tactile image": touch.tactile_image, "true depth": touch.depth, "predicted depth": read}
            for column, (title, image) in enumerate(pictures.items()):
                axes = figure.add_subplot(grid[row, column])
                half_width, half_height = 500 * sensor.width, 500 * sensor.height  # mm
                axes.imshow(image, extent=(-half_width, half_width, half_height, -half_height))
                axes.set(title=title if row == 0 else "", ylabel=f"{touch.name}: y, mm" if column == 0 else "", xlabel="x, mm")
            figure.colorbar(ScalarMappable(Normalize(0, 1e3 * sensor.w), "viridis_r"), ax=axes, shrink=0.8, label="depth, mm")
            axes.set_xlabel(f"x, mm; mean error {1e3 * error:.2f} mm")
            draw_local_points(figure.add_subplot(grid[row, 3], projection="3d"), rows, true[:count], clouds[row], grasp, number)
        save_figure(figure, folder / "local-shape.png")
    text = (
        "Per touch: what the sensor sees, the depth it has, the depth the U-Net predicts from the image, and in 3D the true local points "
        "(blue), the predicted ones (orange) and the chart fitted to them (wire)."
    )
    alt = f"Tactile images, true and predicted depth maps, and local points of {len(touched)} touches of {object_id}"
    return PaperFigure("Local points and touch charts, predicted and true (Figure 3)", text, [Picture("figures/local-shape.png", alt)])


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

    def local(points: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(1e3 * (points @ to_sensor[:3, :3].T + to_sensor[:3, 3]))

    for points, color in ((local(true), COLORS[0]), (1e3 * cloud, COLORS[1])):
        axes.scatter(*points[:: max(1, len(points) // POINTS)].T, s=0.6, color=tuple(channel / 255 for channel in color))
    charts = rows["charts"]
    if is_surface(charts["stop_rule"][grasp, sensor]):
        chart = local(charts["vertices"][grasp, sensor])
        axes.plot_trisurf(*chart.T, triangles=charts["chart_faces"], color=(0, 0, 0, 0), edgecolor=(0, 0, 0, 0.35), linewidth=0.3)
    axes.set_xlabel("x, mm", labelpad=-8)
    axes.set_ylabel("y, mm", labelpad=-8)
    axes.set_zlabel("depth, mm", labelpad=-6)
    axes.set_box_aspect(None, zoom=0.8)  # else the label is outside the figure
    axes.locator_params(nbins=4)
    axes.tick_params(labelsize=6, pad=-3)
    axes.view_init(elev=35, azim=-60)


def _sphere(source: ReportSource, renderer: Renderer, folder: Path, object_id: str) -> PaperFigure:
    """Draw the sphere of vision charts before any deformation, where an object is, neighbouring charts in different colours."""
    points, charts = source.rows(object_id)["surfaces"]["points"].astype(np.float64), vision_charts()
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    camera = fitted_camera(source.scene().square_camera(PIXELS), 1.4 * RADIUS * charts.vertices + middle)
    pictures = []
    for number, (gap, caption) in enumerate(((1.0, "closed: vertices at the seams coincide"), (1.25, "the charts drawn apart"))):
        chart = np.arange(len(charts.vertices)) // CHART_VERTICES
        offset = (gap - 1) * charts.vertices[charts.centres][chart]
        mesh = colored_charts(charts, RADIUS * (charts.vertices + offset) + middle)
        alt = f"Sphere of {len(charts.centres)} charts, {caption}"
        pictures.append(save_picture(render_mesh(renderer, mesh, camera), folder, f"sphere-{number + 1}.png", alt, caption))
    text = f"The {len(charts.centres)} vision charts, {len(charts.vertices)} vertices, that the graph network deforms."
    return PaperFigure("The sphere of vision charts (Figure 4)", text, pictures, "steps")


def colored_charts(
    charts: VisionCharts,
    vertices: NDArray[np.float64],  # (V, 3) m, which may have moved
) -> Mesh:
    """Make a mesh of vision charts, neighbouring ones in different colours."""
    return painted_mesh(vertices, charts.faces, charts.faces[:, 0] // CHART_VERTICES % len(COLORS), [(*color, 255) for color in COLORS])
