"""The pictures of the stages that make data."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.contrib.report.figures import procedure_steps
from pipeline.dataset.object_rows import ObjectRows, sensor_of
from pipeline.drawing.colors import COLORS, depth_colors
from pipeline.drawing.sequence_pictures import first_sequence
from pipeline.kernels.vision.camera import project_points, projection_matrix
from pipeline.store.directory import DataDirectory
from schemas.catalogue import ARTIFACTS
from schemas.presses import PRESSED
from tools.picture_row import draw_row
from tools.slide_picture import slide_panels
from tools.stage_pictures.subject import Subject, cutting_plane, frame_cut, outline

SLAB = 0.004
"""m on either side of a cut in which points are drawn."""
CLIPPED = 0.1
"""m at which colours of distances end."""
SEGMENTS = np.array([[235, 235, 238], COLORS[0], COLORS[1]], np.uint8)
"""Colours of background, object and hand."""
VIEWPOINTS = 6
"""Renderings that are shown of an object."""
PRESSES, CLEAR_CONTACT = 6, 0.12
"""Presses that are shown, and the share of an image in contact that shows most."""
CONTACT_COLOR = np.array([1.0, 0.75, 0.4])


def draw_surfaces(subject: Subject, path: Path) -> None:
    """Draw the mesh, its points as the camera sees them, and a cut."""
    points, normals = (subject.rows["surfaces"][name].astype(np.float64) for name in ("points", "normals"))
    camera = subject.scene.camera
    facing = ((np.array(camera.position) - points) * normals).sum(axis=1) > 0
    pixels = project_points(projection_matrix(camera), points[facing])

    def scatter(axes: Any) -> None:
        axes.scatter(*pixels.T, s=0.3, c=(normals[facing] + 1) / 2)
        axes.set_aspect("equal")
        axes.invert_yaxis()
        axes.set_axis_off()

    def cut(axes: Any) -> None:
        across, offset = cutting_plane(points)
        near = np.abs(points[:, across] - offset) < SLAB
        in_plane = [axis for axis in range(3) if axis != across]
        axes.scatter(*points[near][:, in_plane].T, s=4, color="C0")
        outline(axes, subject.mesh(), across, offset, "0.6")
        frame_cut(axes)

    draw_row(
        [("normalised mesh", subject.picture_of(subject.mesh())), ("points, coloured by normal", scatter), ("a cut: only outside", cut)],
        path,
    )


def draw_distances(subject: Subject, path: Path) -> None:
    """Draw the points of a cut, coloured by their distance."""
    row = subject.source.directory.collection(ARTIFACTS["distances"]).view(subject.object_id)
    points, distance = row["query_points"].astype(np.float64), row["signed_distance"]
    across, offset = cutting_plane(subject.rows["surfaces"]["points"])
    in_plane = [axis for axis in range(3) if axis != across]

    def cut(axes: Any) -> None:
        near = np.abs(points[:, across] - offset) < 2 * SLAB
        colors = distance[near] / CLIPPED
        axes.scatter(*points[near][:, in_plane].T, s=4, c=np.sign(colors) * np.sqrt(np.abs(colors)), cmap="RdBu", vmin=-1, vmax=1)
        outline(axes, subject.mesh(), across, offset, "black")
        frame_cut(axes)

    draw_row([("object", subject.picture_of(subject.mesh())), ("points of a cut", cut)], path)


def draw_grasps(subject: Subject, path: Path) -> None:
    """Draw the steps of the grasp."""
    steps = procedure_steps(subject.source, subject.renderer, subject.object_id, subject.grasp)
    titles = ("1. the palm is placed", "2. posture found, drawn back", "3. closed in physics", "4. what touches")
    if path.stem == "read-grasps":
        titles = ("hand of the file, open", "pre-grasp of the file", "grasp of the file", "what touches")
    draw_row([(title, image) for title, (_, image) in zip(titles, steps, strict=True)], path)


def draw_vision(subject: Subject, path: Path) -> None:
    """Draw the images without and with the hand, and their segmentation."""
    vision, grasp = subject.rows["vision"], subject.grasp
    segments = vision["segmentation"][1 + grasp, 0]
    draw_row(
        [("V_u: alone", vision["unoccluded"][0]), ("V_o: in a grasp", vision["occluded"][grasp, 0]), ("segmentation", SEGMENTS[segments])],
        path,
    )


def draw_touch(subject: Subject, path: Path) -> None:
    """Draw tactile images above depth maps."""
    touch, sensors = subject.rows["touch"], subject.source.sensors()
    names = [mount.name for mount in subject.source.hand().sensors]
    tactile_images, depths = touch["tactile_image"][subject.grasp], touch["depth"][subject.grasp]
    maps = [depth_colors(depth, sensor) for depth, sensor in zip(depths, sensors, strict=True)]
    panels = [
        *zip(names, tactile_images, strict=True),
        *((f"D ≥ {1e3 * depth.min():.1f} mm", depth_map) for depth, depth_map in zip(depths, maps, strict=True)),
    ]
    draw_row(panels, path, columns=len(names))


def draw_presses(subject: Subject, path: Path) -> None:
    """Draw the tactile image of the clearest press of each shape, above the gel's indentation: bright is deep, orange touches."""
    names = ("press_shape", "press_image", "press_indentation", "press_contact")
    row = subject.source.directory.collection(ARTIFACTS["presses"]).view(subject.object_id)
    shapes, images, indentations, contacts = (row[name] for name in names)
    clear = [(abs(float(contacts[n].mean()) - CLEAR_CONTACT), n) for n in range(len(shapes))]
    best = [min(item for item in clear if shapes[item[1]] == code)[1] for code in np.unique(shapes)]
    selected = sorted(best, key=lambda n: clear[n])[:PRESSES]
    maps = []
    for n in selected:
        grey = 60 + 195 * np.maximum(indentations[n], 0)[..., None] / indentations[n].max() * np.ones(3)
        maps.append(np.where(contacts[n][..., None], grey * CONTACT_COLOR, grey).astype(np.uint8))
    titles = [f"{PRESSED[shapes[n]]}, {1e3 * indentations[n].max():.1f} mm" for n in selected]
    draw_row([*zip(titles, images[selected], strict=True), *(("", picture) for picture in maps)], path, columns=len(selected))


def draw_slides(subject: Subject, path: Path) -> None:
    """Draw a step of each part of the first slide, and the forces over time: tactile images above motion and slip of the gel."""
    slides = subject.source.directory.collection(ARTIFACTS["slides"])
    (touches,) = first_sequence(slides.view(subject.object_id), "slide").touches.values()
    draw_row(slide_panels(touches, sensor_of(slides.first), {"pressed": 0.25, "slid": 0.5, "then twisted": 0.75}), path, columns=4)


def draw_renderings(directory: DataDirectory, path: Path) -> None:
    """Draw renderings of a test object."""
    rows = ObjectRows(directory.root, ["rendering"], "test")
    object_id = rows.object_ids[0]
    images = rows.read("rendering", object_id)[:VIEWPOINTS]
    draw_row([(f"viewpoint {number}", image) for number, image in enumerate(images)], path)
