"""The files and sensors of a hand, for keys and settings: kept between runs, because reading its meshes takes seconds."""

import json
import os
from collections.abc import Iterable
from contextlib import suppress
from importlib.util import cache_from_source
from pathlib import Path
from typing import NamedTuple

from pipeline.formats.description_file import description_path
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import sensor_names

KEPT = Path(cache_from_source(__file__)).with_name("hands.json")
MOST = 10
"""Hands that are kept."""


class HandListing(NamedTuple):
    """What a hand is described by."""

    files: list[Path]  # as `Hand.files`
    sensors: list[str]  # as `sensor_names`


def list_hand(name: str | Path) -> HandListing:
    """List a hand's files and sensors; it is read, with all its meshes, unless nothing was written since it was last read."""
    path = str(description_path("hand", name).resolve())
    code = _stamps(Path(__file__).parent.glob("*.py"))
    kept: dict[str, list[list[str]]] = {}
    with suppress(OSError, ValueError, KeyError, TypeError):
        stored = json.loads(KEPT.read_bytes())
        kept = stored["hands"] if stored["code"] == code else {}
        files, sensors, stamps = kept[path]
        if stamps == _stamps_around(map(Path, files)):
            return HandListing([Path(file) for file in files], sensors)
    hand = load_hand(name)
    listing = HandListing(hand.files, list(sensor_names(hand)))
    if not any(shape.mesh.unread for link in hand.links for shape in (*link.visuals, *link.collisions)):  # a missing file may appear
        kept = dict(list(kept.items())[1 - MOST :])
        kept[path] = [[str(file) for file in listing.files], listing.sensors, _stamps_around(listing.files)]
        unfinished = KEPT.with_name(f"{KEPT.name}.{os.getpid()}")
        with suppress(OSError):  # the folder may not be written to
            unfinished.parent.mkdir(exist_ok=True)
            unfinished.write_text(json.dumps({"code": code, "hands": kept}))
            unfinished.replace(KEPT)
    return listing


def _stamps_around(files: Iterable[Path]) -> list[str]:
    """Return what changes whenever one of the files is written or replaced, or another is put beside it."""
    return _stamps({path for file in files for path in (file, file.parent)})


def _stamps(paths: Iterable[Path]) -> list[str]:
    states = [(path, path.stat()) for path in sorted(paths)]
    return [f"{path} {state.st_mtime_ns} {state.st_ctime_ns} {state.st_ino} {state.st_size}" for path, state in states]
