"""Draw the picture of each stage that a dataset has been through; a stage that has not been run has none.

python -m tools.stage_pictures data/toy/draft docs/pictures [OBJECT]

OBJECT is one of the test split; without it, the one whose best grasp hides least.
"""

import sys
from collections.abc import Callable
from pathlib import Path

from pipeline.models.families import FAMILIES
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location, as_location, exists
from schemas.catalogue import ARTIFACTS
from schemas.renderings import RENDERINGS
from tools.stage_pictures.data_stages import (
    draw_distances,
    draw_grasps,
    draw_presses,
    draw_renderings,
    draw_slides,
    draw_surfaces,
    draw_touch,
    draw_vision,
)
from tools.stage_pictures.learning_stages import (
    draw_charts,
    draw_deformation,
    draw_implicit,
    draw_local_network,
    draw_reconstructions,
    draw_unet,
)
from tools.stage_pictures.subject import Subject, open_subject

PICTURES: dict[str, tuple[Callable[[Subject, Path], None], str]] = {
    "sample-surfaces": (draw_surfaces, "surfaces"),
    "simulate-grasps": (draw_grasps, "grasps"),
    "render-vision": (draw_vision, "vision"),
    "simulate-touch": (draw_touch, "touch"),
    "simulate-presses": (draw_presses, "presses"),
    "simulate-slides": (draw_slides, "slides"),
    "train-unet": (draw_unet, "models/unet"),
    "train-touch": (draw_local_network, "models/touch"),
    "fit-charts": (draw_charts, "charts"),
    "train-gcn": (draw_deformation, "gcn"),
    "sample-distances": (draw_distances, "distances"),
    "train-implicit": (draw_implicit, "implicit"),
    "evaluate": (draw_reconstructions, "evaluation"),
}
"""The function that draws each stage's picture, and the artifact or model that it needs."""


def draw_stages(data: Location, folder: Path, object_id: str | None = None) -> None:
    """Draw the picture of each stage that a dataset has been through into `folder`, as STAGE.webp: of an object, or of the clearest."""
    directory = DataDirectory(data)
    if directory.collection(RENDERINGS).shards:
        draw_renderings(directory, folder / "read-renderings.webp")
        return
    with open_subject(data, object_id) as subject:
        for stage, (draw, need) in PICTURES.items():
            if _is_made(subject, need):
                maker = directory.collection(ARTIFACTS[need]).first.record.stage if need in ARTIFACTS else stage
                draw(subject, folder / f"{maker}.webp")


def _is_made(subject: Subject, need: str) -> bool:
    """Tell whether an artifact, a folder, or a trained network of a family exists."""
    if need in ARTIFACTS:
        return bool(subject.source.directory.collection(ARTIFACTS[need]).shards)
    return need in subject.networks if need in FAMILIES else exists(subject.source.directory.folder_record(need))


if __name__ == "__main__":
    draw_stages(as_location(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:4])
