"""Load the subject of the pictures of stages: one object, in one grasp, of a dataset that went through every stage."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from pipeline.contrib.report.figures import PIXELS, clearest_grasp
from pipeline.contrib.report.report_source import ReportSource
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.drawing.grasp_pictures import surroundings
from pipeline.drawing.views import render_mesh
from pipeline.errors import StageError
from pipeline.kernels.vision.scene import Scene
from pipeline.models.families import FAMILIES, ROWS, load_reconstructor, trained_folder
from pipeline.models.observation import Observation, observed_arrays, stored_observation
from pipeline.models.reconstruction import Reconstructor
from pipeline.models.shipped_weights import DEFAULT, shipped_models
from pipeline.store.storage import Location
from stages.render_vision.renderer import Renderer


@dataclass(frozen=True, eq=False)
class Subject:
    """The subject of all pictures: an object in a grasp, and by family a network with its inputs."""

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
        """Return the object's normalised mesh."""
        return read_mesh(self.rows["surfaces"])

    def part(self) -> tuple[slice, slice]:
        """Find the part of the camera's image, `PIXELS` per side, that shows object and hand."""
        large = self.rows["vision"]["segmentation"][[0, 1 + self.grasp], 0] > 0
        scale = PIXELS / large.shape[1]
        row, col = surroundings(large)
        return slice(int(scale * row.start), int(scale * row.stop)), slice(int(scale * col.start), int(scale * col.stop))

    def picture_of(self, mesh: Any) -> NDArray[np.uint8]:
        """Render a mesh at the object's place."""
        return render_mesh(self.renderer, mesh)[self.part()]


@contextmanager
def open_subject(data: Location, object_id: str | None = None) -> Iterator[Subject]:
    """Choose a grasp, of an object of the test split or of the one where it is clearest, and load what its pictures need."""
    source = ReportSource(data)
    tested = ObjectRows(data, ["points"], "test").object_ids  # networks have not seen them
    candidates = [name for name in source.object_ids if name in tested]
    if object_id not in (None, *candidates):
        raise StageError(f"{object_id} is no object of the test split; these are {', '.join(candidates)}")
    object_id, grasp = clearest_grasp(source, [object_id] if object_id else candidates)
    scene = source.scene()
    networks = _networks(source, object_id, grasp)  # before OpenGL is opened: what torch imports for them must be loaded before Mesa
    with Renderer(scene, PIXELS) as renderer:
        yield Subject(source, networks, renderer, scene, object_id, grasp)


def _networks(source: ReportSource, object_id: str, grasp: int) -> dict[str, tuple[Reconstructor, Observation]]:
    """Load a network per family and what it is given, all grasps, the shown one first.

    The network is the one of those trained that is given most; of implicit networks, where none was trained, the one that ships.
    """
    networks = {}
    count = len(source.rows(object_id)["grasps"]["hand_pose"])
    grasps = [(grasp + step) % count for step in range(count)]
    for family in FAMILIES:
        trained = [name for name in source.directory.folders() if name.startswith(f"models/{family}/")]
        if trained:
            name = max(trained, key=len)
            network = load_reconstructor(name.rpartition("/")[2], source.directory.verified_folder(name))
        elif family == ROWS[DEFAULT].family and "charts" in source.collections:
            network = load_reconstructor(f"{DEFAULT}-occluded-touch", trained_folder(shipped_models(), DEFAULT))
        else:
            continue
        rows = ObjectRows(source.directory.root, observed_arrays(network.config), None)
        networks[family] = network, stored_observation(rows, object_id, grasps, network.config)
    return networks


def cutting_plane(points: NDArray[np.float64]) -> tuple[int, float]:
    """Find the upright plane through the middle of points along their longer side: its normal's axis, and where it is, m."""
    axis = int(np.ptp(points[:, :2], axis=0).argmin())
    return axis, float((points[:, axis].min() + points[:, axis].max()) / 2)


def outline(axes: Any, mesh: Any, across: int, offset: float, color: str) -> None:
    """Draw the lines in which a mesh is cut."""
    normal = np.eye(3)[across]
    cut = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    lines: Any = trimesh.intersections.mesh_plane(cut, normal, offset * normal)  # type: ignore[no-untyped-call]
    axes.add_collection(LineCollection(lines[:, :, [axis for axis in range(3) if axis != across]], colors=color, linewidths=1))


def frame_cut(axes: Any) -> None:
    """Show what was drawn of a cut, in true proportions."""
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()
