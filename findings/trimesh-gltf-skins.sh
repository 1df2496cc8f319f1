#!/bin/sh
# trimesh places skinned glTF meshes where no viewer shows them.
#
# One expects: the vertices of a skinned mesh are moved by its joints, and the transform of its own node is ignored (glTF 2.0, section 3.7.3.3:
#     "the node's transform ... must be ignored"), as Blender, three.js and the sample viewer do.
# What happens: joints and weights are dropped, and the node's transform is applied: this box of 0.1 x 0.2 x 0.3 m about z = 1 m, modelled in
#     centimetres below a joint of scale 0.01, is read as 10 x 20 x 30 m at x = 5. No warning. Morph targets with a default weight are dropped too.
# Whom it hurts: characters and rigged objects from asset stores, whose armatures convert centimetres to metres, are 100 times too large, and
#     "keep the size that the file states" keeps a wrong one.
# Versions: trimesh 5.2.0, numpy 2.4.6, networkx 3.6.1. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check trimesh==5.2.0 networkx==3.6.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import base64
import json

import numpy as np
import trimesh

box = trimesh.creation.box((10, 20, 30))
positions = box.vertices.astype("<f4")
arrays = [positions, box.faces.astype("<u2"), np.zeros((8, 4), "u1"), np.tile(np.array([1, 0, 0, 0], "<f4"), (8, 1)), np.eye(4, dtype="<f4")]
starts = np.cumsum([0, *(array.nbytes for array in arrays)]).tolist()
kinds = [(5126, "VEC3", 8), (5123, "SCALAR", 36), (5121, "VEC4", 8), (5126, "VEC4", 8), (5126, "MAT4", 1)]
accessors = [{"bufferView": i, "componentType": kind, "type": shape, "count": count} for i, (kind, shape, count) in enumerate(kinds)]
accessors[0] |= {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
data = base64.b64encode(b"".join(array.tobytes() for array in arrays)).decode()
tree = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0, 1]}],
    "nodes": [{"scale": [0.01] * 3, "translation": [0, 0, 1]}, {"mesh": 0, "skin": 0, "translation": [5, 0, 0]}],
    "skins": [{"joints": [0], "inverseBindMatrices": 4}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1}]}],
    "accessors": accessors,
    "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": array.nbytes} for start, array in zip(starts, arrays)],
    "buffers": [{"byteLength": starts[-1], "uri": f"data:application/octet-stream;base64,{data}"}],
}
with open("skinned.gltf", "w") as file:
    json.dump(tree, file)
low, high = trimesh.load_scene("skinned.gltf").bounds
shown = positions * 0.01 + [0, 0, 1]  # joint times inverse bind matrix, with weight 1
print(f"expected: {np.ptp(shown, axis=0).round(3)} m about {shown.mean(axis=0).round(3)}")
print(f"read:     {(high - low).round(3)} m about {((low + high) / 2).round(3)}")
raise SystemExit(not np.allclose([low, high], [positions.min(axis=0) + [5, 0, 0], positions.max(axis=0) + [5, 0, 0]]))
END
