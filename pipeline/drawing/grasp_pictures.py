"""Draw grasps: from a second side, the surface that each sensor touched, camera images, tactile images and depth maps."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.drawing.colors import Color, depth_colors, finger_colors
from pipeline.drawing.views import cameras_around, lamp_beside, towards, zoomed
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.depth_maps import in_gel
from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from pipeline.kernels.vision.camera import Camera, camera_pose, project_points, projection_matrix
from pipeline.kernels.vision.scene import Label, Scene
from stages.render_vision.renderer import PosedMesh, Renderer

Picture = NDArray[np.uint8]  # (rows, cols, 3)
Rows = Mapping[str, Mapping[str, np.ndarray]]  # an object's rows, by artifact
TRIAL_RESOLUTION = 48  # pixels per side of the images that decide between cameras: enough to count what they show
STRIDE = 3  # every `STRIDE`-th pixel of a sensor becomes a vertex of its patch
SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))  # the corners of a gel, in half sides
LINE, RIM, FINE = 1.5, 2.5, 4
"""Width of a square's outline and of the white rim under it, pixels; Pillow draws no smooth lines: `FINE` times as large, then averaged."""
LIFT = 4e-4  # distance of a patch in front of the surface it marks, m: it stays visible over a coarse mesh between its vertices


class GraspPictures:
    """Draws the grasps of one hand, with its sensors, in one scene."""

    def __init__(self, renderer: Renderer, scene: Scene, hand: Hand, sensors: Sequence[Sensor]) -> None:
        """Add the hand's shapes to the renderer."""
        self.renderer, self.scene, self.hand, self.sensors = renderer, scene, hand, sensors
        self.links = [(link, renderer.add(mesh, Label.HAND), mesh) for link, mesh in hand.visual_meshes]

    @contextmanager
    def second_side(self, rows: Rows, grasp: int, pixels: int) -> Iterator["SecondSide"]:
        """Add an object to the renderer for as long as the context lasts, and look at a grasp of it from a second side."""
        mesh = read_mesh(rows["surfaces"])
        with self.renderer.added(mesh, Label.OBJECT) as handle:
            yield SecondSide(self, (handle, np.eye(4)), mesh.vertices, rows, grasp, pixels)


class SecondSide:
    """A grasp seen from another side than the scene's camera sees it, the lamp moved along."""

    def __init__(
        self,
        pictures: GraspPictures,
        posed_object: PosedMesh,
        vertices: Array,  # (V, 3) of the object, world, m
        rows: Rows,
        grasp: int,
        pixels: int,  # per side
    ) -> None:
        self.pictures, self.posed_object, self.vertices = pictures, posed_object, vertices
        self.grasp = {name: rows["grasps"][name][grasp] for name in ("hand_pose", "joint_angles", "sensor_pose", "touch_success")}
        self.depth = rows["touch"]["depth"][grasp]  # (S, rows, cols) m
        self.squares = gel_squares(self.grasp["sensor_pose"], pictures.sensors)  # drawn over images to mark what hides a patch
        self.colors = finger_colors(len(self.squares))
        self.camera = pictures.scene.square_camera(pixels)

    def hand(self, joint_angles: Array) -> list[PosedMesh]:  # (J,)
        """Pose the hand's shapes."""
        frames = forward_kinematics(self.pictures.hand, self.grasp["hand_pose"], joint_angles)  # (L, 4, 4)
        return [(handle, frames[link]) for link, handle, _ in self.pictures.links]

    @cached_property
    def near(self) -> Camera:
        """The camera close to the hand that shows most of hand and object, across the palm; chosen by rendering trials."""
        posed_hand = self.hand(self.grasp["joint_angles"])
        shapes = zip(self.pictures.links, posed_hand, strict=True)
        points = np.vstack([*(transform_points(pose, mesh.vertices) for (_, _, mesh), (_, pose) in shapes), self.squares.reshape(-1, 3)])
        palm = self.grasp["hand_pose"][:3, :3] @ self.pictures.hand.palm_facing

        def score(camera: Camera) -> float:
            trial = self.pictures.renderer.render([self.posed_object, *posed_hand], camera.with_resolution(TRIAL_RESOLUTION))
            labels = trial.segmentation
            across = 1 - float(camera_pose(camera)[:3, 2] @ palm) ** 2  # sin²: 1 from the hand's side, 0 from its back
            return float((labels == Label.OBJECT).sum()) * float((labels == Label.HAND).sum()) * across

        return max(cameras_around(self.camera, points), key=score)

    def posture(self, joint_angles: Array) -> Picture:  # (J,)
        """Render the hand in a posture, and the object."""
        return self._render([self.posed_object, *self.hand(joint_angles)], self.near)

    def held(self) -> Picture:
        """Render the grasp, with the gels' outlines."""
        return self._outlined(self.posture(self.grasp["joint_angles"]), self.near)

    def touched(self) -> Picture:
        """Render the whole object without the hand, the surface that each sensor touched in its colour."""
        camera = towards(self.camera, self.vertices, camera_pose(self.near)[:3, 2])
        camera = zoomed(camera, np.vstack([self.vertices, self.squares[self.grasp["touch_success"]].reshape(-1, 3)]))
        sites = zip(self.depth, self.grasp["sensor_pose"], self.pictures.sensors, self.colors, strict=True)
        patches = [touch_patch(*site) for site, contact in zip(sites, self.grasp["touch_success"], strict=True) if contact]
        with ExitStack() as added:
            marks = [(added.enter_context(self.pictures.renderer.added(patch, Label.HAND)), np.eye(4)) for patch in patches if patch]
            image = self._render([self.posed_object, *marks], camera)
        return self._outlined(image, camera)

    def _render(self, meshes: Sequence[PosedMesh], camera: Camera) -> Picture:
        return self.pictures.renderer.render_colors(meshes, camera, lamp_beside(self.pictures.scene, camera))

    def _outlined(self, image: Picture, camera: Camera) -> Picture:
        """Draw the gels' squares over an image: smooth lines in their colours on a white rim."""
        canvas = Image.fromarray(image).resize((FINE * image.shape[1], FINE * image.shape[0]), Image.Resampling.NEAREST)
        pencil, matrix = ImageDraw.Draw(canvas), projection_matrix(camera)
        for square, color in zip(self.squares, self.colors, strict=True):
            corners = [(float(u), float(v)) for u, v in FINE * project_points(matrix, square[[0, 1, 2, 3, 0, 1]])]
            for ink, width in (((255, 255, 255), RIM), (color, LINE)):
                pencil.line(corners, fill=ink, width=round(width * FINE), joint="curve")
        return np.asarray(canvas.resize((image.shape[1], image.shape[0]), Image.Resampling.BOX))


class Touch(NamedTuple):
    """What a sensor measured in a grasp."""

    name: str
    color: Color
    touched: bool
    tactile_image: Picture
    depth: Picture
    note: str  # how deep the surface is in the gel, or how near


def touches_of(rows: Rows, grasp: int, hand: Hand, sensors: Sequence[Sensor]) -> list[Touch]:
    """Collect what each sensor measured in a grasp."""
    touched, images, depths = rows["grasps"]["touch_success"], rows["touch"]["tactile_image"], rows["touch"]["depth"]
    parts = zip(hand.sensors, finger_colors(len(sensors)), touched[grasp], images[grasp], depths[grasp], sensors, strict=True)
    return [
        Touch(mount.name, color, bool(contact), image, depth_colors(depth, sensor), depth_note(contact, depth))
        for mount, color, contact, image, depth, sensor in parts
    ]


def camera_images(vision: Mapping[str, np.ndarray], grasp: int) -> list[tuple[str, Picture]]:
    """Caption the camera images of a grasp, without and, if rendered, with the hand, enlarged if the object is small in them."""
    images, masks = {"camera image": vision["unoccluded"][0]}, vision["segmentation"][:1, 0] > 0
    if "occluded" in list(vision):
        images["with the hand"] = vision["occluded"][grasp, 0]
        masks = vision["segmentation"][[0, 1 + grasp], 0] > 0
    row, col = surroundings(masks)
    side = max(row.stop - row.start, col.stop - col.start)
    if not 0 < 2 * side <= masks.shape[1]:
        return list(images.items())
    return [(f"{caption}, enlarged {masks.shape[1] / side:.1f} ×", image[row, col]) for caption, image in images.items()]


def surroundings(
    masks: NDArray[np.bool_],  # (view, rows, cols)
) -> tuple[slice, slice]:
    """Find the square part of images around all of these masks; it is empty if the masks are."""
    pixels = np.argwhere(masks.any(axis=0))
    if not len(pixels):
        return slice(0, 0), slice(0, 0)
    middle, reach = (pixels.min(axis=0) + pixels.max(axis=0)) // 2, int(np.ptp(pixels, axis=0).max() * 0.6) + 1
    row, col = (slice(max(0, at - reach), at + reach) for at in middle)
    return row, col


def depth_note(touched: bool, depth: NDArray[np.floating]) -> str:
    """Describe the point of a depth map that is nearest to the sensor plane."""
    nearest = float(depth.min())
    return f"{'touch' if touched else 'no touch'} · {1e3 * nearest:.1f} mm" if np.isfinite(nearest) else "nothing in range"


def size_note(surface: Mapping[str, NDArray[Any]]) -> str:
    """Describe an object's size, along x, y and z, from its row of `surfaces`."""
    return f"{' × '.join(f'{100 * extent:.3g}' for extent in np.ptp(surface['meshes/vertices'], axis=0))} cm"


def grasp_note(row: Mapping[str, NDArray[Any]], grasp: int) -> str:
    """Describe a grasp, from an object's row of `grasps`: touches, penetration, contacts, force closure, hold test."""
    touched = row["touch_success"][grasp]
    note = f"{touched.sum()} of {len(touched)} sensors touch; rigid parts at most {1e3 * float(row['penetration'][grasp]):.2f} mm inside"
    angle, margin, area = (float(np.sum(row[name][grasp])) for name in ("opposition", "closure", "contact_area"))
    closed = f"force-closed with margin {margin:.2f}" if margin > 0 else "not force-closed"
    note += f"; {1e6 * area:.0f} mm² of contact, normals up to {angle:.0f}° apart; {closed}"
    if "held" in list(row):
        note += f"; {'held' if row['held'][grasp] else 'dropped'} in the hold test"
    if "held_directions" in list(row):
        note += f", in {row['held_directions'][grasp].sum()} of 6 directions"
    return note


def touch_patch(
    depth: NDArray[np.float32],  # (rows, cols) m
    pose: Array,  # (4, 4) sensor to world
    sensor: Sensor,
    color: Color,
) -> Mesh | None:  # None if the gel is empty
    """Make a mesh of the surface in a sensor's gel, `LIFT` in front of it."""
    x, y = (centres[::STRIDE] for centres in pixel_centres(sensor))
    sampled = depth[::STRIDE, ::STRIDE].astype(np.float64)
    inside = in_gel(depth.astype(np.float64), sensor)[::STRIDE, ::STRIDE]
    local = np.stack([*np.meshgrid(x, y), np.where(inside, sampled - LIFT, 0)], axis=-1).reshape(-1, 3)
    number = np.arange(local.shape[0]).reshape(inside.shape)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    quads = quads[inside.reshape(-1)[quads].all(axis=1)]
    if not len(quads):
        return None
    faces = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    return Mesh(transform_points(pose, local), faces, Look.plain(len(local), len(faces), color))


def gel_squares(
    poses: Array,  # (S, 4, 4) sensors to world
    sensors: Sequence[Sensor],
) -> Array:  # (S, 4, 3) world, m
    """Compute the corners of the gels' front faces."""
    corners = [[(x * sensor.width / 2, y * sensor.height / 2, sensor.w) for x, y in SQUARE] for sensor in sensors]
    return transform_points(poses, np.array(corners))
