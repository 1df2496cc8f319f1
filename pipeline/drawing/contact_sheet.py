"""Contact sheets: the best grasps of some objects, and animations of slides and lifts; drawn again only if the shown rows have changed."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from pipeline.console import with_progress
from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.drawing.picture_sheet import PICTURE, SheetRow, Tile, draw_sheet, spread_evenly
from pipeline.drawing.written_files import WrittenFiles, read_list
from pipeline.engine.keys import sources_hash
from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.atomic import atomic_writes
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory, changed_files
from pipeline.store.record import Sha256
from pipeline.store.shard import RowView
from pipeline.store.storage import Location, remove
from schemas.catalogue import ARTIFACTS
from schemas.sequences import SEQUENCES

if TYPE_CHECKING:
    from pipeline.drawing.grasp_pictures import GraspPictures, Rows

SHOWN = ("surfaces", "grasps", "vision", "touch")  # the artifacts that a contact sheet shows
ANIMATED = 4  # objects whose first slide or lift is animated


class Sheets(WrittenFiles):
    """The sheets of a data directory; no other file of it is replaced or removed."""

    key: Sha256  # hash of all that they show
    files: dict[Annotated[str, Field(pattern=r"^(contact-sheet(-[0-9]+)?\.png|(slides|lifts)\.webp)$")], Sha256]


def contact_sheets(data: Location, max_objects: int) -> list[Location]:
    """Draw the best grasp of at most `max_objects` objects, spread over the dataset; return the sheets' paths."""
    source = CompletedObjects(data, SHOWN)
    object_ids = spread_evenly(source.object_ids, max_objects)
    return _drawn(source, object_ids, "contact-sheet.key", lambda out: draw_contact_sheet(source, object_ids, out / "contact-sheet.png"))


def sequence_animations(data: Location) -> list[Location]:
    """Animate the first slide and lift of a few objects; return the files' paths, none of a kind that lacks an array that is shown."""
    from pipeline.drawing.sequence_pictures import animate, are_drawable, first_sequence

    paths = list[Location]()
    for kind, artifact in SEQUENCES.items():
        if are_drawable(DataDirectory(data).collection(ARTIFACTS[artifact]), kind):
            source = CompletedObjects(data, [artifact])
            object_ids = spread_evenly(source.object_ids, ANIMATED)
            views = [source.collections[artifact].view(object_id) for object_id in object_ids]

            def draw(folder: Path, kind: str = kind, views: Sequence[RowView] = views) -> None:
                (folder / f"{kind}s.webp").write_bytes(animate([first_sequence(view, kind) for view in views]))

            paths += _drawn(source, object_ids, f"{kind}s.key", draw)
    return paths


def _drawn(source: CompletedObjects, object_ids: Sequence[str], listed: str, draw: Callable[[Path], object]) -> list[Location]:
    """Draw files of a data directory, unless those in the list of this name show the same; return their paths."""
    data = source.directory.root
    key = digest.of_json([sources_hash(__name__), object_ids, [collection.digest() for collection in source.collections.values()]])
    try:
        sheets = read_list(data / listed, Sheets)
    except StoreError:  # none was drawn, or the list is damaged
        sheets = Sheets(key="0" * 64, files={})
    if sheets.key != key or changed_files(data, sheets.files):
        before = sheets.files
        with atomic_writes(data) as folder:
            draw(folder)
            sheets = Sheets(key=key, files=hashes_of(folder))
            (folder / listed).write_text(sheets.model_dump_json())
            for obsolete in before.keys() - sheets.files.keys():
                remove(data / obsolete)
    return [data / name for name in sorted(sheets.files, key=lambda name: (len(name), name))]  # page 2 before page 10


def draw_contact_sheet(source: CompletedObjects, object_ids: Sequence[str], path: Path) -> list[Path]:
    """Draw the best grasps of objects into a file; later pages are called NAME-2.png and so on."""
    from pipeline.drawing.grasp_pictures import GraspPictures
    from stages.render_vision.renderer import Renderer

    rows, scene, sensors = [], source.scene(), source.sensors()
    with Renderer(scene) as renderer:
        pictures = GraspPictures(renderer, scene, source.hand(), sensors)
        for object_id in with_progress(object_ids, "contact sheets", after=1.0):
            rows.append(sheet_row(pictures, object_id, source.rows(object_id)))
    note = (
        f"the best grasp of {len(object_ids)} of {len(source.collections['grasps'])} objects; a filled dot is a touch; "
        "mm: deepest point, from the sensor plane"
    )
    return draw_sheet(rows, path, title=source.name, note=note, sensor=sensors[0])


def sheet_row(pictures: "GraspPictures", object_id: str, rows: "Rows") -> SheetRow:
    """Make the row of an object's best grasp from its rows of the artifacts `SHOWN`."""
    from pipeline.drawing.grasp_pictures import camera_images, grasp_note, size_note, touches_of

    with pictures.second_side(rows, 0, PICTURE) as side:
        views = [("from a second side", side.held()), ("touch sites", side.touched())]
    images = [Tile(caption, [image]) for caption, image in (*camera_images(rows["vision"], 0), *views)]
    touches = [
        Tile(touch.name, [touch.tactile_image, touch.depth], touch.note, touch.color, touch.touched)
        for touch in touches_of(rows, 0, pictures.hand, pictures.sensors)
    ]
    return SheetRow(f"{object_id}, {size_note(rows['surfaces'])}", grasp_note(rows["grasps"], 0), [*images, *touches])
