"""Draw a dataset's contact sheets, the best grasps of objects; they are drawn again only if the shown rows have changed."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from pipeline.console import Meter, errors
from pipeline.contrib.report.report_pages import WrittenFiles
from pipeline.dataset.grasping_hand import grasping_hand
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.touch_sensors import touch_sensors
from pipeline.dataset.vision_scene import dataset_scene
from pipeline.drawing.contact_sheet_page import Band, draw, enlarged, finger_colors, grasp_note, size_note, spread_evenly
from pipeline.drawing.second_view import GraspView, gel_squares, grasp_cameras, second_view, touch_patch
from pipeline.engine.keys import sources_hash
from pipeline.errors import StoreError
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.vision.scene import Label, Scene
from pipeline.store import digest
from pipeline.store.atomic import atomic_writes
from pipeline.store.collection import Collection
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory, changed_files
from pipeline.store.origins import check_origins
from pipeline.store.record import Sha256
from pipeline.store.storage import Location, exists, read_bytes, remove
from schemas.catalogue import ARTIFACTS
from stages.render_vision.renderer import Renderer

SHOWN = ("surfaces", "grasps", "vision", "touch")
"""The artifacts that a contact sheet shows."""

DRAWN = "contact-sheet.key"
"""The list of the sheets that were drawn, in a data directory."""


class Sheets(WrittenFiles):
    """The sheets of a data directory; no other file of it is replaced or removed."""

    files: dict[Annotated[str, Field(pattern=r"^contact-sheet(-[0-9]+)?\.png$")], Sha256]


def contact_sheets(data: Location, max_objects: int) -> list[Location]:
    """Draw the best grasp of at most `max_objects` objects, spread over the dataset; return the sheets' paths."""
    collections, object_ids = _choose_objects(data, max_objects)
    key = digest.of_json([sources_hash(__name__), object_ids, [collection.digest() for collection in collections.values()]])
    drawn = _read_drawn(data / DRAWN)
    if drawn is None or not drawn.is_up_to_date(key, changed_files(data, drawn.files)):
        with atomic_writes(data) as folder:
            _draw(collections, object_ids, folder / "contact-sheet.png")
            sheets = Sheets(key=key, files=hashes_of(folder))
            (folder / DRAWN).write_text(sheets.model_dump_json())
            for obsolete in drawn.files.keys() - sheets.files.keys() if drawn else ():
                if exists(data / obsolete):
                    remove(data / obsolete)
        drawn = sheets
    return [data / name for name in sorted(drawn.files, key=lambda name: (len(name), name))]  # page 2 before page 10


def draw_contact_sheet(data: Location, max_objects: int, path: Path) -> list[Path]:
    """Draw a contact sheet into a file elsewhere; later pages are called NAME-2.png and so on. Errors as `contact_sheets`."""
    return _draw(*_choose_objects(data, max_objects), path)


def _choose_objects(data: Location, max_objects: int) -> tuple[dict[str, Collection], list[str]]:
    """Choose the objects to draw."""
    directory = DataDirectory(data)
    collections = {name: directory.collection(ARTIFACTS[name]) for name in SHOWN}
    for collection in collections.values():
        collection.first  # noqa: B018 (an error where it has not been made)
    check_origins(directory, SHOWN)
    sound = [name for name in collections["surfaces"] if all(c.failure(name) is None for c in collections.values())]
    if not sound:
        raise StoreError(f"{data.resolve()}: no object came through all stages; `vt-pipeline status {shlex.quote(str(data))}` says why")
    return collections, spread_evenly(sound, max_objects)


def _read_drawn(path: Location) -> Sheets | None:
    try:
        return Sheets.model_validate_json(read_bytes(path)) if exists(path) else None
    except ValidationError:
        return None


def _draw(collections: Mapping[str, Collection], ids: list[str], path: Path) -> list[Path]:
    attributes, grasps = {name: collection.first.attributes for name, collection in collections.items()}, collections["grasps"]
    bands = []
    with band_maker(attributes) as maker, Meter(errors, "contact sheets", len(ids), "objects", after=1.0) as meter:
        for object_id in ids:
            bands.append(maker.band(object_id, {name: c.view(object_id) for name, c in collections.items()}))
            meter.advance()
    title = f"{attributes['grasps']['manifest']} · {grasps.first.record.preset}"
    note = f"the best grasp of {len(ids)} of {len(grasps)} objects; a filled dot is a touch; mm: deepest point, from the sensor plane"
    return draw(bands, path, maker.sensors, title=title, note=note)


class BandMaker:
    """Make bands for one hand with its sensors in one scene; `band_maker` opens one."""

    def __init__(self, renderer: Renderer, *, scene: Scene, hand: Hand, sensors: Sequence[Sensor]) -> None:
        """Add the hand's shapes to the renderer."""
        self.renderer, self.scene, self.hand, self.sensors = renderer, scene, hand, sensors
        self.shapes = [(link, renderer.add(mesh, Label.HAND), mesh) for link, mesh in hand.visual_meshes]

    @contextmanager
    def grasp_view(self, rows: Mapping[str, Mapping[str, np.ndarray]], grasp: int) -> Iterator[GraspView]:
        """Add an object to the renderer while the context lasts, and collect the second view of a grasp."""
        row, depths = rows["grasps"], rows["touch"]["depth"][grasp]
        poses, hand_pose, colors = row["sensor_pose"][grasp], row["hand_pose"][grasp], finger_colors(len(depths))
        frames = forward_kinematics(self.hand, hand_pose, row["joint_angles"][grasp])  # (L, 4, 4)
        sites = zip(depths, poses, self.sensors, colors, strict=True)
        patches = [touch_patch(*site) for site, contact in zip(sites, row["touch_success"][grasp], strict=True) if contact]
        mesh = read_mesh(rows["surfaces"])
        with self.renderer.added(mesh, Label.OBJECT) as handle:
            yield GraspView(
                object_mesh=(handle, mesh),
                hand=[(shape, surface, frames[link]) for link, shape, surface in self.shapes],
                patches=[patch for patch in patches if patch is not None],
                palm=hand_pose[:3, :3] @ self.hand.palm_facing,
                squares=gel_squares(poses, self.sensors),
                colors=colors,
            )

    def band(self, object_id: str, rows: Mapping[str, Mapping[str, np.ndarray]]) -> Band:
        """Make the band of an object's best grasp from its rows of the artifacts `SHOWN`."""
        grasps, touch, vision = rows["grasps"], rows["touch"], rows["vision"]
        touched, depths = grasps["touch_success"][0], touch["depth"][0]
        images = {"unoccluded": vision["unoccluded"][0]} | ({"occluded": vision["occluded"][0, 0]} if "occluded" in list(vision) else {})
        size = len(images["unoccluded"])
        with self.grasp_view(rows, 0) as view:
            cameras = grasp_cameras(self.renderer, self.scene, size, view)
            grasp_image, touch_image = second_view(self.renderer, self.scene, cameras, view)
        masks = vision["segmentation"][:2, 0] > 0
        return Band(
            title=f"{object_id}, {size_note(rows['surfaces'])}",
            note=grasp_note(grasps, 0),
            pictures=[
                *((f"{name}{scale}", picture) for name, image in images.items() for picture, scale in [enlarged(image, masks)]),
                ("from a second side", grasp_image),
                ("touch sites", touch_image),
            ],
            fingers=[mount.name for mount in self.hand.sensors],
            touched=touched,
            tactile_images=touch["tactile_image"][0],
            depths=depths,
        )


@contextmanager
def band_maker(attributes: Mapping[str, Mapping[str, Any]]) -> Iterator[BandMaker]:
    """Open a `BandMaker` for the scene, the hand and the sensors in the artifacts' attributes, for as long as the context lasts."""
    scene, hand = dataset_scene(attributes["vision"]), grasping_hand(attributes)
    with Renderer(scene) as renderer:
        yield BandMaker(renderer, scene=scene, hand=hand, sensors=touch_sensors(attributes["touch"]))
