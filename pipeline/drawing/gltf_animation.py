"""Animations in glTF scenes: poses of nodes over time, which trimesh cannot write."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

STILL = 1e-6
"""m or matrix entry; nodes that move less get no track."""
LENGTH_STEP, TURN_STEP = 2.0**-15, 2.0**-13
"""m and part of a quaternion to which tracks are rounded, 30 µm and at most 0.03°, so that files compress."""
FLOAT = 5126
"""glTF's number of float32."""


@dataclass(frozen=True, eq=False)
class Clip:
    """An animation."""

    name: str
    times: NDArray[np.float64]  # (T,) s
    poses: Mapping[str, NDArray[np.float64]]  # by node, (T, 4, 4) in the node above, m


def clip_writer(clips: Sequence[Clip]) -> Callable[[dict[str, bytes], dict[str, Any]], None]:
    """Make a `buffer_postprocessor` for trimesh's export of GLB, which adds animations to the file.

    Nodes of the clips are in the scene, and their poses rigid. The function changes the buffers and the tree that it is
    given.
    """

    def write(buffers: dict[str, bytes], tree: dict[str, Any]) -> None:
        numbers = {node["name"]: number for number, node in enumerate(tree["nodes"])}
        for clip in clips:
            animation: dict[str, Any] = {"name": clip.name, "samplers": [], "channels": []}
            times = _append(buffers, tree, clip.times[:, None], "SCALAR")
            for name, poses in clip.poses.items():
                if np.abs(poses - poses[0]).max() < STILL:
                    continue
                for path, values, kind in (("translation", _positions(poses), "VEC3"), ("rotation", _quaternions(poses), "VEC4")):
                    output = _append(buffers, tree, values, kind)
                    target = {"node": numbers[name], "path": path}
                    animation["channels"].append({"sampler": len(animation["samplers"]), "target": target})
                    animation["samplers"].append({"input": times, "output": output, "interpolation": "LINEAR"})
                _decompose_pose(tree["nodes"][numbers[name]])
            if animation["channels"]:
                tree.setdefault("animations", []).append(animation)

    return write


def _append(buffers: dict[str, bytes], tree: dict[str, Any], values: NDArray[np.float64], kind: str) -> int:
    """Append an array (T, K) to the file; return its number."""
    name, stored = f"animation {len(buffers)}", values.astype("<f4")
    buffers[name] = stored.tobytes()
    ends = {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
    tree["accessors"][name] = {
        "bufferView": len(buffers) - 1, "componentType": FLOAT, "count": len(stored), "type": kind, "byteOffset": 0, **ends
    }  # fmt: skip
    return len(tree["accessors"]) - 1


def _positions(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.round(poses[:, :3, 3] / LENGTH_STEP) * LENGTH_STEP


def _quaternions(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute (T, 4) quaternions x, y, z, w, each with the sign nearest to the one before."""
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    signs = np.cumprod(np.concatenate([[1.0], np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1.0, 1.0)]))
    rounded = np.round(signs[:, None] * quaternions / TURN_STEP) * TURN_STEP
    return np.asarray(rounded / np.linalg.norm(rounded, axis=1, keepdims=True))


def _decompose_pose(node: dict[str, Any]) -> None:
    """Write a node's pose as translation and rotation: glTF cannot animate a matrix."""
    if (matrix := node.pop("matrix", None)) is not None:
        pose = np.array(matrix, np.float64).reshape(4, 4).T  # columns first
        node["translation"] = pose[:3, 3].tolist()
        node["rotation"] = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
