"""The files and sensors of a hand, for keys and settings."""

from importlib.util import cache_from_source
from pathlib import Path
from typing import NamedTuple

from pipeline.formats.description_file import description_path
from pipeline.formats.file_cache import FileCache
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import sensor_names

KEPT = Path(cache_from_source(__file__)).with_name("hands.json")


class HandListing(NamedTuple):
    """What a hand is described by."""

    files: list[Path]  # as `Hand.files`
    sensors: list[str]  # as `sensor_names`


def list_hand(name: str | Path) -> HandListing:
    """List a hand's files and sensors; it is read, with all its meshes, unless nothing was written since it was last read."""
    path = str(description_path("hand", name).resolve())
    cache = FileCache(KEPT, sorted(Path(__file__).parent.glob("*.py")), limit=10)
    if kept := cache.find(path):
        files, sensors = kept
        return HandListing([Path(file) for file in files], sensors)
    hand = load_hand(name)
    listing = HandListing(hand.files, list(sensor_names(hand)))
    if not any(shape.mesh.unread for link in hand.links for shape in (*link.visuals, *link.collisions)):  # a missing file may appear
        around = {place for file in listing.files for place in (file, file.parent)}  # another file may be put beside one
        cache.keep(path, [[str(file) for file in listing.files], listing.sensors], around)
        cache.save()
    return listing
