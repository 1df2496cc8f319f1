"""A dataset's contact sheets: drawn from the store, and only when what they show has changed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.keys import sources_hash
from pipeline.errors import StoreError
from pipeline.reports.contact_band import BandMaker, band_maker
from pipeline.reports.contact_sheet import Band, draw
from pipeline.store import digest
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory
from pipeline.store.shard import RowView
from schemas.catalogue import ARTIFACTS

SHOWN = ("surfaces", "grasps", "vision", "touch")
"""The artifacts that a contact sheet shows."""


def contact_sheets(data: Path, most: int) -> list[Path]:
    """Draw the best grasp of at most `most` objects, spread evenly over the dataset; returns the pages' paths.

    Raises
    ------
    StoreError
        An artifact has not been made, or no object came through all stages.
    """
    directory = DataDirectory(data)
    collections = {name: directory.collection(ARTIFACTS[name]) for name in SHOWN}
    for collection in collections.values():
        collection.first  # noqa: B018 (an error where it has not been made)
    directory.check_origins(SHOWN)
    sound = [name for name in collections["surfaces"] if all(c.failure(name) is None for c in collections.values())]
    if not sound:
        raise StoreError(f"{data.resolve()}: no object came through all stages; `vt-pipeline status` says why")
    shown = [sound[place] for place in np.linspace(0, len(sound) - 1, min(most, len(sound))).astype(int)]
    key = digest.of_json(
        [sources_hash("pipeline.reports.contact_band"), shown, [collection.digest() for collection in collections.values()]]
    )
    path, stamp = data / "contact-sheet.png", data / "contact-sheet.key"
    drawn = stamp.read_text().splitlines() if stamp.exists() else []
    if drawn[:1] != [key] or not all((data / name).exists() for name in drawn[1:]):
        drawn = [key, *(page.name for page in _draw(collections, shown, path))]
        stamp.write_text("\n".join(drawn) + "\n")
    return [data / name for name in drawn[1:]]


def _draw(collections: Mapping[str, Collection], shown: list[str], path: Path) -> list[Path]:
    touch, vision, grasps = (collections[name].shard(shown[0]).attributes for name in ("touch", "vision", "grasps"))
    sensor = touch["sensor"]
    for old in path.parent.glob(f"{path.stem}*{path.suffix}"):
        old.unlink()
    with band_maker(vision["settings"]["scene"], grasps["settings"]["hand"], sensor["width"], sensor["w"]) as maker:
        bands = [object_band(maker, {name: c.view(object_id) for name, c in collections.items()}) for object_id in shown]
    title = f"{grasps['manifest']} · {collections['grasps'].first.record.preset}"
    total = len(collections["grasps"])
    note = f"the best grasp of {len(shown)} of {total} objects; a filled dot is a touch"
    return draw(bands, path, title, note, sensor["w"], sensor["range"])


def object_band(maker: BandMaker, rows: Mapping[str, RowView]) -> Band:
    """Gather the band of an object's best grasp from its rows."""
    grasps, touch, vision = rows["grasps"], rows["touch"], rows["vision"]
    touched = grasps["touch_success"][0]
    deep = float(grasps["penetration"][0]) * 1e3
    return maker.band(
        title=grasps.object_id,
        note=f"{touched.sum()} of {len(touched)} touch; rigid parts stand {deep:.2f} mm inside",
        mesh=read_mesh(rows["surfaces"]),
        hand_pose=grasps["hand_pose"][0],
        joint_angles=grasps["joint_angles"][0],
        sensor_pose=grasps["sensor_pose"][0],
        touched=touched,
        readings=touch["reading"][0],
        depths=touch["depth"][0],
        unoccluded=vision["unoccluded"],
        occluded=vision["occluded"][0] if "occluded" in list(vision) else np.full_like(vision["unoccluded"], 255),
    )
