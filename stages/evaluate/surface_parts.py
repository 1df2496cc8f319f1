"""Parts of an object's surface on which touch is judged: near touched points, hidden from the camera, and both."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.geometry.exterior_sampling import RAY_OFFSET, RayScene
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import unit_vectors
from pipeline.kernels.metrics.nearest_points import Cloud
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.scene import Label
from pipeline.kernels.vision.view_transfer import optical_centre
from pipeline.models.families import ROWS
from pipeline.models.observation import stored_observation
from stages.evaluate.measure import MeasuredObjects

REACH = 0.01  # m from a touched point, within which a surface point is near the touch
GIVEN = ROWS["implicit-gels-touch"].inputs  # touches as points of any gel
LABELS = {"near": "near the touch", "hidden": "hidden", "hidden_near": "hidden, near the touch"}
"""Labels of the parts in tables; the figure of each is `NAME_distance`."""


class SurfaceParts:
    """The parts of the points of each test object, in the image and by the touches of a grasp.

    They are the same for all methods, whatever these are given, so that figures of a part can be compared.
    """

    def __init__(self, objects: MeasuredObjects, *, image: bool, touch: bool) -> None:
        self.objects, self.image, self.touch = objects, image, touch
        self.masks, self.traced = lru_cache(maxsize=16)(self._masks), lru_cache(maxsize=1)(self._traced)

    def _masks(self, object_id: str, grasp: int) -> dict[str, Mask]:  # (N,) of the object's points, by name
        points, masks = self.objects.points(object_id), dict[str, Mask]()
        if self.touch:
            touched = self.touched(object_id, [grasp])[0]
            squared = Cloud(touched).nearest(Cloud(points))[0] if len(touched) else np.full(len(points), np.inf)
            masks["near"] = squared <= REACH**2
        if self.image:
            masks["hidden"] = hidden_points(points, self.traced(object_id)[1], *self.view(object_id, grasp))
        if self.touch and self.image:
            masks["hidden_near"] = masks["hidden"] & masks["near"]
        return masks

    def touched(self, object_id: str, grasps: Sequence[int]) -> tuple[Array, Array]:  # (N, 3) each
        """Read the points that sensors touched in grasps, world, m, and the normals there, away from the object."""
        touches = stored_observation(self.objects, object_id, grasps, GIVEN).touches
        points, normals = (np.concatenate([getattr(touch, name) for touch in touches]) for name in ("points", "normals"))
        return points.astype(np.float64), normals.astype(np.float64)

    def view(self, object_id: str, grasp: int) -> tuple[Array, NDArray[np.uint8]]:
        """Read the camera (3, 4) of the image of a grasp, and what its pixels show; those of the object alone without such images."""
        cameras, shown = (self.objects.read(name, object_id, camera=0) for name in ("projection", "segmentation"))
        view = 1 + grasp if len(cameras) > 1 else 0
        return cameras[view], shown[view]

    def _traced(self, object_id: str) -> tuple[Mesh, RayScene]:
        mesh = read_mesh(self.objects.surface(object_id))
        return mesh, RayScene(mesh.vertices, mesh.faces)


def hidden_points(
    points: Array,  # (N, 3) world, m, on the surface
    scene: RayScene,  # of the object
    camera: Array,  # (3, 4) projection matrix
    shown: NDArray[np.uint8],  # (rows, cols) `Label` of each pixel
) -> Mask:  # (N,)
    """Find the points that a camera does not see: the object or the hand is in front of them, or they are outside its image.

    Of the object that is exact; at the rim of the hand it is so to a pixel.
    """
    escape = scene.escape(points, unit_vectors(optical_centre(camera) - points), RAY_OFFSET)
    column, row = np.floor(np.nan_to_num(project_points(camera, points), nan=-1)).astype(np.int64).T
    inside = (row >= 0) & (row < shown.shape[0]) & (column >= 0) & (column < shown.shape[1])
    behind_hand = shown[np.where(inside, row, 0), np.where(inside, column, 0)] == Label.HAND
    return np.asarray(~escape | ~inside | behind_hand)
