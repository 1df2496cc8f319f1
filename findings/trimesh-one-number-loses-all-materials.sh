#!/bin/sh
# trimesh drops every material of an OBJ file if one colour of its MTL file is given by one number.
#
# One expects: `Kd 0.5` is grey. The MTL format says so: "If only r is specified, then g, and b are assumed to be equal to r."
# What happens: the whole material library is dropped. The red part of this file is read without a colour too, only because another part is
#     grey. The reason is logged at debug level; the scene looks like one without materials.
# Whom it hurts: objects are rendered in plain grey, and networks learn from images without the colours that the files have.
# Versions: trimesh 5.2.0, pillow 13.0.0, numpy 2.4.6. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check trimesh==5.2.0 pillow==13.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import pathlib

import trimesh

LINES = ["mtllib two.mtl", "v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "usemtl red", "f 1 2 3", "usemtl grey", "f 1 3 4"]
pathlib.Path("two.obj").write_text("\n".join(LINES) + "\n")
colors = {}
for grey in ("0.5 0.5 0.5", "0.5"):
    pathlib.Path("two.mtl").write_text(f"newmtl red\nKd 1 0 0\n\nnewmtl grey\nKd {grey}\n")
    parts = trimesh.load_scene("two.obj", process=False).geometry.values()
    colors[grey] = sorted(part.visual.material.diffuse.tolist() for part in parts if part.visual.kind == "texture")
    print(f"Kd {grey}: {len(parts)} parts, materials {colors[grey]}")
raise SystemExit(colors != {"0.5 0.5 0.5": [[128, 128, 128, 255], [255, 0, 0, 255]], "0.5": []})
END
