"""List the objects of DexGraspBench's grasps, one per object and size, so that `read-grasps` finds the grasps of each.

GRASPS has NAME/SCENE/NUMBER.npy, such as output/example_shadow/graspdata; OBJECTS has NAME/mesh/simplified.obj, such as
assets/example_object. The list is OBJECTS/catalogue.csv, for a manifest with the source {kind: catalogue, path: OBJECTS}.
"""

import argparse
import csv
from pathlib import Path

from pipeline.formats.grasp_file import Stated, read_grasp_file


def write_catalogue(grasps: Path, objects: Path) -> int:
    """Write OBJECTS/catalogue.csv; return the number of its objects."""
    lines = []
    for scene in sorted(folder for folder in grasps.glob("*/*") if folder.is_dir()):
        files = sorted(scene.glob("*.npy"))
        stated = [grasp.stated for file in files[:1] for grasp in read_grasp_file(file, grasps) if isinstance(grasp.stated, Stated)]
        if stated:
            name = scene.parent.name
            lines.append([f"{name}-{scene.name}", "object", f"{name}/mesh/simplified.obj", "z", repr(stated[0].scale)])
    with (objects / "catalogue.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([["object_id", "category", "file", "up", "metres_per_unit"], *lines])
    return len(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("grasps", type=Path)
    parser.add_argument("objects", type=Path)
    given = parser.parse_args()
    print(f"{write_catalogue(given.grasps, given.objects)} objects")
