#!/bin/sh
# trimesh doubles the parts of a 3MF file whose model files use the same object ids.
#
# One expects: object ids count per model file (3MF production extension 1.1, chapter 2: `p:path` names the file), so two components with id 1 in
#     two files are two objects.
# What happens: trimesh keys meshes by id alone. Each component gets the meshes of both files: 48 triangles in place of 24, and the shorter
#     part is as high as the other. No error, no warning. Slicers write such files: one model file per object, each of which starts at id 1.
# Whom it hurts: objects that are read from 3MF get a second body inside them; grasps and touches are made of a shape nobody drew.
# Versions: trimesh 5.2.0, networkx 3.6.1, lxml 6.1.3, numpy 2.4.6. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check trimesh==5.2.0 networkx==3.6.1 lxml==6.1.3 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import zipfile

import trimesh

CORE = 'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"'
PRODUCTION = 'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06" requiredextensions="p"'
RELATION = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"


def part(height: float) -> str:
    box = trimesh.creation.box((10, 20, height))
    vertices = "".join('<vertex x="%g" y="%g" z="%g"/>' % tuple(vertex) for vertex in box.vertices)
    triangles = "".join('<triangle v1="%d" v2="%d" v3="%d"/>' % tuple(face) for face in box.faces)
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
    return f'<model unit="millimeter" {CORE}><resources><object id="1" type="model">{mesh}</object></resources><build/></model>'


objects = "".join(
    f'<object id="{number}" type="model"><components><component objectid="1" p:path="/3D/{name}.model"/></components></object>'
    for number, name in ((10, "low"), (11, "high"))
)
items = '<item objectid="10"/><item objectid="11" transform="1 0 0 0 1 0 0 0 1 50 0 0"/>'
with zipfile.ZipFile("two.3mf", "w") as archive:
    archive.writestr("3D/low.model", part(30))
    archive.writestr("3D/high.model", part(60))
    archive.writestr(
        "3D/3dmodel.model", f'<model unit="millimeter" {CORE} {PRODUCTION}><resources>{objects}</resources><build>{items}</build></model>'
    )
    archive.writestr(
        "_rels/.rels",
        '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
        f'<Relationship Target="/3D/3dmodel.model" Id="r" Type="{RELATION}"/></Relationships>',
    )
scene = trimesh.load_scene("two.3mf")
triangles = len(scene.to_geometry().faces)
print(f"two boxes of 12 triangles, 30 and 60 mm high: {triangles} triangles in {len(scene.graph.nodes_geometry)} instances")
raise SystemExit(triangles != 48)
END
