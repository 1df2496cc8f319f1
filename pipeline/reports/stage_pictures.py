"""Draw the pictures of `docs/how-it-works`, one per stage, all of one object of a dataset that went through every stage.

    python -m pipeline.reports.stage_pictures data/toy/draft docs/pictures

A stage that has not been run has no picture.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import trimesh
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from pipeline.config.scene_file import load_scene
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.kernels.touch.contact import local_points
from pipeline.kernels.touch.gel_surface import in_gel
from pipeline.kernels.vision.camera import project_points, projection_matrix
from pipeline.kernels.vision.scene import Scene
from pipeline.models.observation import Observation, observed_arrays, stored_observation
from pipeline.models.reconstruction import Reconstructor
from pipeline.models.touch_model import load_touch_model
from pipeline.models.trained_networks import FAMILIES, load_reconstructor
from pipeline.reports.contact_sheet_page import COLORS, depth_colors
from pipeline.reports.overview_picture import surroundings
from pipeline.reports.paper_figures import PIXELS, clearest_grasp, colored_charts, draw_local_points, procedure_steps
from pipeline.reports.picture_row import Panel, draw_row
from pipeline.reports.reconstruction_gallery import draw_gallery, render_mesh, two_coloured
from pipeline.reports.report_source import ReportSource
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Place, exists, place
from schemas.catalogue import ARTIFACTS
from schemas.renderings import RENDERINGS
from stages.render_vision.renderer import Renderer

SLAB = 0.004
"""m on either side of a cut in which points are drawn."""
CLIPPED = 0.1
"""m at which colours of distances end."""
SEGMENTS = np.array([[235, 235, 238], COLORS[0], COLORS[1]], np.uint8)
"""Colours of background, object and hand."""
OBJECTS = 5
"""Reconstructions that are shown."""
VIEWPOINTS = 6
"""Renderings that are shown of an object."""

Panels = list[tuple[str, Panel]]


@dataclass(frozen=True, eq=False)
class Shown:
    """What all pictures show: an object in a grasp, and by family a network with what it is given of the object."""

    source: ReportSource
    networks: Mapping[str, tuple[Any, Observation]]
    renderer: Renderer
    scene: Scene
    object_id: str
    grasp: int

    @property
    def rows(self) -> Any:
        """The object's rows, by artifact."""
        return self.source.rows(self.object_id)

    def mesh(self) -> Any:
        """The object's normalised mesh."""
        return read_mesh(self.rows["surfaces"])

    def part(self) -> tuple[slice, slice]:
        """The part of the camera's image, `PIXELS` a side, that object and hand are in."""
        large = self.rows["vision"]["segmentation"][[0, 1 + self.grasp]] > 0
        scale = PIXELS / large.shape[1]
        row, col = surroundings(large)
        return slice(int(scale * row.start), int(scale * row.stop)), slice(int(scale * col.start), int(scale * col.stop))

    def pictured(self, mesh: Any) -> NDArray[np.uint8]:
        """Render a mesh where the object is."""
        return render_mesh(self.renderer, mesh)[self.part()]


def draw_stages(data: Place, folder: Path) -> None:
    """Draw the picture of each stage that a dataset has been through into `folder`, as STAGE.webp.

    Raises
    ------
    StoreError
        The dataset has neither renderings nor grasps and what is made of them.
    """
    directory = DataDirectory(data)
    if directory.collection(RENDERINGS).shards:
        _renderings(directory, folder / "read-renderings.webp")
        return
    with _shown(data) as shown:
        for stage, (draw, need) in PICTURES.items():
            if _is_made(shown, need):
                draw(shown, folder / f"{stage}.webp")


def _is_made(shown: Shown, need: str) -> bool:
    """Whether there is an artifact, a folder, or a trained network of a family."""
    if need in ARTIFACTS:
        return bool(shown.source.directory.collection(ARTIFACTS[need]).shards)
    return need in shown.networks if need in FAMILIES else exists(shown.source.directory.folder_record(need))


@contextmanager
def _shown(data: Place) -> Iterator[Shown]:
    source = ReportSource(data)
    tested = ObjectRows(data, ["points"], "test").object_ids  # networks have not seen them
    object_id, grasp = clearest_grasp(source, [name for name in source.object_ids if name in tested])
    scene = load_scene(str(source.attributes("vision")["settings"]["scene"]))
    networks = _networks(source, object_id, grasp)  # before OpenGL is opened: what torch imports for them crashes beside Mesa
    with Renderer(scene, PIXELS) as renderer:
        yield Shown(source, networks, renderer, scene, object_id, grasp)


def _networks(source: ReportSource, object_id: str, grasp: int) -> dict[str, tuple[Reconstructor, Observation]]:
    """Load a trained network per family, the one that is given most, and what it is given: all grasps, the shown one first."""
    found = {}
    for family in FAMILIES:
        trained = [name for name in source.directory.folders() if name.startswith(f"models/{family}/")]
        if trained:
            folder = max(trained, key=len)
            network = load_reconstructor(folder.rpartition("/")[2], source.directory.whole_folder(folder))
            rows = ObjectRows(source.directory.root, observed_arrays(network.config), None)
            every = len(source.rows(object_id)["grasps"]["hand_pose"])
            grasps = [(grasp + step) % every for step in range(every)]
            found[family] = network, stored_observation(rows, object_id, grasps, network.config)
    return found


def _surfaces(shown: Shown, path: Path) -> None:
    """The mesh, its points as the camera sees them, and a cut."""
    points, normals = (shown.rows["surfaces"][name].astype(np.float64) for name in ("points", "normals"))
    camera = shown.scene.camera
    facing = ((np.array(camera.position) - points) * normals).sum(axis=1) > 0
    pixels = project_points(projection_matrix(camera), points[facing])

    def scatter(axes: Any) -> None:
        axes.scatter(*pixels.T, s=0.3, c=(normals[facing] + 1) / 2)
        axes.set_aspect("equal")
        axes.invert_yaxis()
        axes.set_axis_off()

    def cut(axes: Any) -> None:
        across, offset = _cutting_plane(points)
        near = np.abs(points[:, across] - offset) < SLAB
        seen = [axis for axis in range(3) if axis != across]
        axes.scatter(*points[near][:, seen].T, s=4, color="C0")
        _outline(axes, shown.mesh(), across, offset, "0.6")
        _frame_cut(axes)

    draw_row(
        [("normalised mesh", shown.pictured(shown.mesh())), ("points, coloured by normal", scatter), ("a cut: only outside", cut)], path
    )


def _cutting_plane(points: NDArray[np.float64]) -> tuple[int, float]:
    """The upright plane through the middle of points along their longer side: its normal's axis, and where it is, m."""
    axis = int(np.ptp(points[:, :2], axis=0).argmin())
    return axis, float((points[:, axis].min() + points[:, axis].max()) / 2)


def _outline(axes: Any, mesh: Any, across: int, offset: float, color: str) -> None:
    """Draw the lines in which a mesh is cut."""
    normal = np.eye(3)[across]
    cut = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    lines: Any = trimesh.intersections.mesh_plane(cut, normal, offset * normal)  # type: ignore[no-untyped-call]
    axes.add_collection(LineCollection(lines[:, :, [axis for axis in range(3) if axis != across]], colors=color, linewidths=1))


def _frame_cut(axes: Any) -> None:
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()


def _grasps(shown: Shown, path: Path) -> None:
    """The steps of the grasp."""
    steps = procedure_steps(shown.source, shown.renderer, shown.scene, shown.object_id, shown.grasp)
    titles = ("1. the palm is placed", "2. posture found, drawn back", "3. closed in physics", "4. what touches")
    draw_row([(title, image) for title, (_, image) in zip(titles, steps, strict=True)], path)


def _vision(shown: Shown, path: Path) -> None:
    vision, grasp = shown.rows["vision"], shown.grasp
    segments = vision["segmentation"][1 + grasp]
    draw_row(
        [("V_u: alone", vision["unoccluded"]), ("V_o: in a grasp", vision["occluded"][grasp]), ("segmentation", SEGMENTS[segments])], path
    )


def _touch(shown: Shown, path: Path) -> None:
    """Tactile images above depth maps."""
    touch, sensors = shown.rows["touch"], shown.source.sensors()
    names = [mount.name for mount in shown.source.hand().sensors]
    readings, depths = touch["reading"][shown.grasp], touch["depth"][shown.grasp]
    maps = [depth_colors(depth, sensor) for depth, sensor in zip(depths, sensors, strict=True)]
    panels = [
        *zip(names, readings, strict=True),
        *((f"D ≥ {1e3 * depth.min():.1f} mm", one) for depth, one in zip(depths, maps, strict=True)),
    ]
    draw_row(panels, path, columns=len(names))


def _unet(shown: Shown, path: Path) -> None:
    """A touch, and its depth as predicted."""
    model = load_touch_model(shown.source.directory.whole_folder("models/unet"), "cpu")
    depths, sensors = shown.rows["touch"]["depth"][shown.grasp], shown.source.sensors()
    touched = np.flatnonzero(shown.rows["grasps"]["touch_success"][shown.grasp]).tolist()
    finger = max(touched, key=lambda number: float(np.ptp(depths[number][in_gel(depths[number], sensors[number])])))
    reading, depth = shown.rows["touch"]["reading"][shown.grasp, finger], depths[finger]
    sensor, mask, predicted = model.sensor, model.mask(reading[None])[0], model.depth(reading[None])[0]
    apart = np.where(mask & in_gel(depth, sensor), np.abs(predicted - depth), 0)
    error = matplotlib.colormaps["magma"](np.clip(apart / 0.5e-3, 0, 1))[..., :3]
    panels: Panels = [
        ("tactile image", reading),
        ("true depth", depth_colors(depth, sensor)),
        ("predicted, where it touched", depth_colors(np.where(mask, predicted, np.inf), sensor)),
        (f"error, mean {1e3 * apart[apart > 0].mean():.2f} mm", np.round(255 * error).astype(np.uint8)),
    ]
    draw_row(panels, path)


def _charts(shown: Shown, path: Path) -> None:
    """True and predicted points of the grasp's touches, with their charts."""
    rows, sensors = shown.rows, shown.source.sensors()
    model = load_touch_model(shown.source.directory.whole_folder("models/unet"), "cpu")
    panels: Panels = []
    for finger in np.flatnonzero(rows["grasps"]["touch_success"][shown.grasp]).tolist():
        pose, depth = rows["grasps"]["sensor_pose"][shown.grasp, finger], rows["touch"]["depth"][shown.grasp, finger]
        points, count = local_points(depth, pose, sensors[finger])
        cloud = model.clouds(rows["touch"]["reading"][shown.grasp, finger][None])[0]
        panels.append((shown.source.hand().sensors[finger].name, _local_points(rows, points[:count], cloud, shown.grasp, finger)))
    draw_row(panels, path, projection="3d")


def _local_points(*drawn: Any) -> Callable[[Any], None]:
    return lambda axes: draw_local_points(axes, *drawn)


def _deformation(shown: Shown, path: Path) -> None:
    """The vision charts after each pass, then with the touch charts."""
    network, observation = shown.networks["gcn"]
    made = []
    config = network.network.config
    for passes in range(config.passes + 1):
        network.network.config = config.model_copy(update={"passes": passes})  # the same weights in each pass
        made.append(network.reconstruct([observation])[0])
    panels: Panels = [("what is seen", observation.image)] if observation.image is not None else []
    for passes, one in enumerate(made):
        title = f"after pass {passes}" if passes else "sphere of charts"
        panels.append((title, shown.pictured(colored_charts(network.network.charts, one.vertices[: one.vision]))))
    grey = int((made[-1].faces < made[-1].vision).all(axis=1).sum())
    panels.append(("with touch charts", shown.pictured(two_coloured(made[-1].vertices, made[-1].faces, grey))))
    draw_row([*panels, ("object", shown.pictured(shown.mesh()))], path)


def _distances(shown: Shown, path: Path) -> None:
    """The points of a cut, coloured by their distance."""
    row = shown.source.directory.collection(ARTIFACTS["distances"]).view(shown.object_id)
    points, distance = row["query_points"].astype(np.float64), row["signed_distance"]
    across, offset = _cutting_plane(shown.rows["surfaces"]["points"])
    seen = [axis for axis in range(3) if axis != across]

    def cut(axes: Any) -> None:
        near = np.abs(points[:, across] - offset) < 2 * SLAB
        colors = distance[near] / CLIPPED
        axes.scatter(*points[near][:, seen].T, s=4, c=np.sign(colors) * np.sqrt(np.abs(colors)), cmap="RdBu", vmin=-1, vmax=1)
        _outline(axes, shown.mesh(), across, offset, "black")
        _frame_cut(axes)

    draw_row([("object", shown.pictured(shown.mesh())), ("points of a cut", cut)], path)


def _implicit(shown: Shown, path: Path) -> None:
    """The closed mesh that is predicted, and a cut through it and the object."""
    network, observation = shown.networks["implicit"]
    made = network.reconstruct([observation])[0]
    predicted = two_coloured(made.vertices, made.faces, len(made.faces))

    def cut(axes: Any) -> None:
        plane = _cutting_plane(shown.rows["surfaces"]["points"])
        _outline(axes, shown.mesh(), *plane, "black")
        _outline(axes, predicted, *plane, "C1")
        _frame_cut(axes)

    panels: Panels = [("what is seen", observation.image)] if observation.image is not None else []
    pictures = [("predicted mesh", shown.pictured(predicted)), ("object", shown.pictured(shown.mesh()))]
    draw_row([*panels, *pictures, ("cut: true black", cut)], path)


def _gallery(shown: Shown, path: Path) -> None:
    draw_gallery(shown.source.directory.root, path, OBJECTS)


def _renderings(directory: DataDirectory, path: Path) -> None:
    """Renderings of a test object."""
    rows = ObjectRows(directory.root, ["rendering"], "test")
    object_id = rows.object_ids[0]
    images = rows.read("rendering", object_id)[:VIEWPOINTS]
    draw_row([(f"viewpoint {number}", image) for number, image in enumerate(images)], path)


PICTURES: dict[str, tuple[Callable[[Shown, Path], None], str]] = {
    "sample-surfaces": (_surfaces, "surfaces"),
    "simulate-grasps": (_grasps, "grasps"),
    "render-vision": (_vision, "vision"),
    "simulate-touch": (_touch, "touch"),
    "train-unet": (_unet, "models/unet"),
    "fit-charts": (_charts, "charts"),
    "train-gcn": (_deformation, "gcn"),
    "sample-distances": (_distances, "distances"),
    "train-implicit": (_implicit, "implicit"),
    "evaluate": (_gallery, "evaluation"),
}
"""How each stage's picture is drawn, and what has to be there for it."""


if __name__ == "__main__":
    draw_stages(place(sys.argv[1]), Path(sys.argv[2]))
