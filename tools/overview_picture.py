"""Draw the README's picture: an object, a grasp, what its sensors measure, and its reconstruction.

    python -m tools.overview_picture data/toy/draft OBJECT docs/overview.png

OBJECT is one of the test split; the last configuration that `evaluate` measured reconstructs it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.reports.contact_sheet import SHOWN, band_maker
from pipeline.reports.contact_sheet_page import depth_colors
from pipeline.reports.reconstruction_gallery import predicted_mesh, render_mesh
from pipeline.store.directory import DataDirectory
from schemas.catalogue import ARTIFACTS
from schemas.charts import CHARTS
from stages.evaluate.evaluation_files import read_root, read_surfaces
from tools.picture_row import draw_row


def draw_overview(data: Path, object_id: str, path: Path) -> None:
    """Draw an object of the test split in a row of pictures, as a PNG."""
    directory = DataDirectory(data)
    rows = {name: directory.collection(ARTIFACTS[name]).view(object_id) for name in SHOWN}
    evaluation = directory.whole_folder("evaluation")
    table = read_surfaces(evaluation, list(read_root(evaluation)["configurations"])[-1])
    case = int(np.argmax(table["grasps_given"]))
    with band_maker({name: row.shard.attributes for name, row in rows.items()}) as maker:
        band = maker.band(object_id, rows)
        reconstruction = render_mesh(maker.renderer, predicted_mesh(directory.collection(CHARTS), object_id, table, case))
    (_, seen), (_, occluded), (_, held), _ = band.pictures
    part = surroundings(rows["vision"]["segmentation"][:2, 0] > 0)
    panels = [
        ("object", seen[part]),
        ("in a grasp", occluded[part]),
        ("from a second side", held),
        ("tactile images", _grid(list(band.tactile_images))),
        ("depth maps", _grid([depth_colors(depth, sensor) for depth, sensor in zip(band.depths, maker.sensors, strict=True)])),
        (f"reconstruction, {table['grasps_given'][case]} grasps", reconstruction[part]),
    ]
    draw_row(panels, path)


def surroundings(shown: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Find the square part of images around what any of these masks (view, row, col) shows."""
    found = np.argwhere(shown.any(axis=0))
    middle, reach = (found.min(axis=0) + found.max(axis=0)) // 2, int(np.ptp(found, axis=0).max() * 0.6)
    row, col = (slice(max(0, at - reach), at + reach) for at in middle)
    return row, col


def _grid(tiles: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Lay tiles in two columns, with white between them."""
    framed = [np.pad(tile, ((2, 2), (2, 2), (0, 0)), constant_values=255) for tile in tiles]
    framed += [np.full_like(framed[0], 255)] * (len(framed) % 2)
    return np.concatenate([np.concatenate(framed[start : start + 2], axis=1) for start in range(0, len(framed), 2)])


if __name__ == "__main__":
    draw_overview(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
