"""Export to glTF scenes: an object with the hand, sensors, touched surface and touch charts of its grasps."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.console import Meter, errors
from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.drawing.grasp_scene import GraspScenes
from pipeline.errors import InvalidInput
from pipeline.store.atomic import atomic_writes, write_atomically


def write_scenes(
    source: CompletedObjects,
    out: Path,  # folder for `OBJECT.glb`, or a .glb file for one object
    objects: Sequence[str],  # names; empty for all
) -> int:  # the number of objects
    """Write each object's scene as glTF.

    Meshes are as stored. Lengths are m; glTF is y up: each top node turns the world, z up.
    """
    object_ids = list(objects) or source.object_ids
    for name in object_ids:
        source.check_known(name)
    one_file = out.suffix.lower() == ".glb"
    if one_file and len(object_ids) > 1:
        raise InvalidInput(f"{out} is one file, and there are {len(object_ids)} objects; name one with --object, or a folder")
    scenes = GraspScenes(source.hand(), source.sensors(), small=False)

    def glb(name: str) -> bytes:
        return scenes.glb(scenes.scene(source.rows(name)))

    if one_file:
        write_atomically(out, glb(object_ids[0]))
        return 1
    with atomic_writes(out) as folder, Meter(errors, "export", len(object_ids), "objects") as meter:
        for name in object_ids:
            (folder / f"{name}.glb").write_bytes(glb(name))
            meter.advance()
    return len(object_ids)
