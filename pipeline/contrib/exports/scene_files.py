"""Export to glTF scenes: an object with the hand, sensors, touched surface and touch charts of its grasps."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.console import pluralise, with_progress
from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.drawing.grasp_scene import GraspScenes
from pipeline.store.storage import Location


def export_scenes(data: Location, folder: Path, objects: Sequence[str] = ()) -> str:
    """Write `OBJECT.glb` of each object, by default of all; meshes are as stored, m, each top node turns the world, z up, to y up."""
    source = CompletedObjects(data, ("surfaces", "grasps", "touch"), ("charts",))
    for name in objects:
        source.check_known(name)
    object_ids = list(objects) or source.object_ids
    scenes = GraspScenes(source.hand(), source.sensors(), small=False)
    for name in with_progress(object_ids, "export", after=1.0):
        (folder / f"{name}.glb").write_bytes(scenes.glb(scenes.scene(source.rows(name))))
    return pluralise(len(object_ids), "scene")
