"""Count what was not computed per scene because nothing in the dataset depends on it."""

from collections import Counter

from pipeline.console import Row, Table
from pipeline.contrib.report.report_source import ReportSource
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.drawing.contact_sheet_page import spread_evenly
from pipeline.kernels.touch.ray_depth import box_faces, cull_faces
from pipeline.kernels.vision.primitives import faces_by_material, shrink_texture

OBJECTS = 4
"""Objects that are counted, spread evenly: a fraction of a second each."""


def left_out_table(source: ReportSource) -> Table:
    """Count faces, sensors, attempts, materials and texels of a few objects; say which % were left out, and why."""
    object_ids = spread_evenly(source.object_ids, OBJECTS)
    total, used = Counter[str](), Counter[str]()
    for name in object_ids:
        rows, sensors = source.rows(name), source.sensors()
        mesh = read_mesh(rows["surfaces"])
        faces = box_faces(mesh.triangles)
        faces_per_sensor = [
            cull_faces(faces, pose, sensor).shape[2]
            for grasp in rows["grasps"]["sensor_pose"]
            for pose, sensor in zip(grasp, sensors, strict=True)
        ]
        total["faces before a sensor"] += len(faces_per_sensor) * len(mesh.faces)
        used["faces before a sensor"] += sum(faces_per_sensor)
        total["sensors"] += len(faces_per_sensor)
        used["sensors"] += sum(count > 0 for count in faces_per_sensor)
        total["attempts at a grasp"] += max(
            int(source.attributes("grasps")["settings"].get("attempts", 0)), attempts := int(rows["grasps"]["attempts"])
        )
        used["attempts at a grasp"] += attempts
        total["materials"] += len(mesh.look.base_color)
        used["materials"] += len(faces_by_material(mesh.look))
        total["texels"] += sum(texture.shape[0] * texture.shape[1] for texture in mesh.look.textures)
        used["texels"] += sum(small.shape[0] * small.shape[1] for small in map(shrink_texture, mesh.look.textures))
    table = [Row([kind, total[kind], 100 * (1 - used[kind] / total[kind]) if total[kind] else 0.0, why]) for kind, why in REASONS.items()]
    return Table(f"counted on {', '.join(object_ids)}", ["", "there are", "left out, %", "because"], table, ["", ",", ".3g", ""])


REASONS = {
    "faces before a sensor": "no ray of the sensor can meet them",
    "sensors": "no face is within their range",
    "attempts at a grasp": "no further one could be kept",
    "materials": "they look like another one, and are drawn with it",
    "texels": "finer than any image shows",
}
