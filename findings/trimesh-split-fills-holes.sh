#!/bin/sh
# trimesh closes holes of the parts that `split` returns, also where it is asked to keep open parts.
#
# One expects: `split(only_watertight=False)` divides a mesh into its connected parts and changes no face of them.
# What happens: holes of three or four corners are filled first (`repair=True` by default), so that an open part comes back closed, with faces
#     that the file does not have. `only_watertight=False` only leaves out the test after the repair.
# Whom it hurts: programs that take closed convex parts for solid and treat open sheets otherwise, as collision shapes for physics.
# Remedy: split(only_watertight=False, repair=False).
# Versions: trimesh 5.2.0, networkx 3.6.1, scipy 1.17.1, numpy 2.4.6, Python 3.11. Date: 2026-11-30.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check trimesh==5.2.0 networkx==3.6.1 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import trimesh

box = trimesh.creation.box()
whole = trimesh.Trimesh(box.vertices, box.faces[:-1], process=False)
(part,), (kept,) = whole.split(only_watertight=False), whole.split(only_watertight=False, repair=False)
for name, mesh in {"a box without one triangle": whole, "its part": part, "its part with repair=False": kept}.items():
    print(f"{name}: {len(mesh.faces)} faces, closed: {mesh.is_watertight}")
surprising = not whole.is_watertight and part.is_watertight and len(part.faces) == 12 and not kept.is_watertight
raise SystemExit(not surprising)
END
