"""Nearest points on the faces of a mesh, for groups of points that lie close together: a tree of boxes is searched once per group.

A face is compared with all points of a group at once, in loops without branches, which become vector instructions; their order is fixed.
"""

from typing import NamedTuple

import numpy as np

from pipeline.kernels.arrays import Array, Indices, Integers
from pipeline.kernels.compiled import compiled

LEAF = 4  # faces in a leaf
TINY = np.finfo(np.float64).tiny


class FaceTree(NamedTuple):
    """A binary tree of boxes around faces; the children of box n are 2n + 1 and 2n + 2, those of the last level hold `LEAF` faces each."""

    boxes: Array  # (B, 6) least x, y, z and greatest
    corners: Array  # (P, 3, 3) of the faces, leaf by leaf; some repeat
    faces: Indices  # (P,) their numbers in the mesh


def build_face_tree(
    vertices: Array,  # (V, 3)
    faces: Integers,  # (F, 3), F > 0
) -> FaceTree:
    """Build a tree that halves the faces along the longest side of their centres' box, level by level."""
    triangles = vertices[faces]
    centres, levels = triangles.mean(axis=1), max(0, int(np.ceil(np.log2(len(faces) / LEAF))))
    order = np.resize(np.arange(len(faces)), LEAF << levels)
    for level in range(levels):
        nodes = order.reshape(1 << level, -1)
        places = centres[nodes]  # (nodes, faces, 3)
        longest = np.ptp(places, axis=1).argmax(axis=1)
        along = np.take_along_axis(places, longest[:, None, None], axis=2)[..., 0]
        order = np.take_along_axis(nodes, np.argsort(along, axis=1, kind="stable"), axis=1).ravel()
    corners = np.ascontiguousarray(triangles[order])
    of_leaves = corners.reshape(-1, 3 * LEAF, 3)
    boxes = [np.concatenate([of_leaves.min(axis=1), of_leaves.max(axis=1)], axis=1)]
    for _ in range(levels):
        pairs = boxes[-1].reshape(-1, 2, 6)
        boxes.append(np.concatenate([pairs[..., :3].min(axis=1), pairs[..., 3:].max(axis=1)], axis=1))
    return FaceTree(np.concatenate(boxes[::-1]), corners, order)


def nearest_points(
    tree: FaceTree,
    points: Array,  # (N, 3) finite
    group: int = 1,  # number of successive points that lie close together, which divides N
) -> tuple[Array, Indices, Array]:  # (N,), (N,), (N, 3)
    """Find the points on the faces that are nearest to others: squared distances, numbers of the faces, and the nearest points."""
    squared, face, nearest = _search_groups(tree, np.ascontiguousarray(points).reshape(-1, group, 3))
    return squared.ravel(), face.ravel(), nearest.reshape(-1, 3)


@compiled
def _search_groups(tree: FaceTree, groups: Array) -> tuple[Array, Indices, Array]:  # (K, N), (K, N), (K, N, 3)
    """Find the nearest points for groups (K, N, 3)."""
    squared, face, nearest = np.empty(groups.shape[:2]), np.empty(groups.shape[:2], np.int64), np.empty(groups.shape)
    size, leaves, leaf = groups.shape[1], len(tree.boxes) // 2, 0
    points, waiting = np.empty((3, size)), np.empty(64, np.int64)
    for k in range(len(groups)):
        best, number = squared[k], face[k]
        for n in range(size):
            best[n], number[n] = np.inf, leaf * LEAF  # what it stays where squares overflow
            points[0, n], points[1, n], points[2, n] = groups[k, n, 0], groups[k, n, 1], groups[k, n, 2]
        _search_leaf(tree.corners, leaf, points, best, number)  # the one that was nearest to the group before
        waiting[0], count = 0, 1
        while count:
            count -= 1
            box = waiting[count]
            if not _reaches(tree.boxes, box, points, best):
                continue
            if box >= leaves:
                _search_leaf(tree.corners, box - leaves, points, best, number)
            else:
                left, right = 2 * box + 1, 2 * box + 2
                is_left = _offset(tree.boxes, left, points) < _offset(tree.boxes, right, points)
                waiting[count], waiting[count + 1] = (right, left) if is_left else (left, right)  # the last is searched first
                count += 2
        leaf = number[0] // LEAF
        for n in range(size):
            x, y, z = groups[k, n, 0], groups[k, n, 1], groups[k, n, 2]
            px, py, pz = _nearest_on_face(tree.corners, number[n], x, y, z)
            best[n] = _dot(x - px, y - py, z - pz, x - px, y - py, z - pz)
            nearest[k, n, 0], nearest[k, n, 1], nearest[k, n, 2] = px, py, pz
            number[n] = tree.faces[number[n]]
    return squared, face, nearest


@compiled
def _reaches(boxes: Array, box: int, points: Array, squared: Array) -> bool:
    """Check whether a box is nearer to any of some points (3, N) than their squared distances (N,)."""
    ax, ay, az, bx, by, bz = boxes[box]
    count = 0
    for n in range(len(squared)):
        x, y, z = points[0, n], points[1, n], points[2, n]
        dx, dy, dz = max(max(ax - x, x - bx), 0.0), max(max(ay - y, y - by), 0.0), max(max(az - z, z - bz), 0.0)
        count += int(dx * dx + dy * dy + dz * dz < squared[n])
    return count > 0


@compiled
def _offset(boxes: Array, box: int, points: Array) -> float:
    """Compute how far a box's middle is from the first of some points (3, N), along all axes; twice that."""
    offset = 0.0
    for axis in range(3):
        offset += abs(boxes[box, axis] + boxes[box, axis + 3] - 2 * points[axis, 0])
    return offset


@compiled
def _search_leaf(corners: Array, leaf: int, points: Array, squared: Array, number: Indices) -> None:
    """Lower the squared distances (N,) of points (3, N) to those of the faces of a leaf: of their edges, or of their planes beside them."""
    for item in range(leaf * LEAF, leaf * LEAF + LEAF):
        ax, ay, az = corners[item, 0]
        bx, by, bz = corners[item, 1]
        cx, cy, cz = corners[item, 2]
        ux, uy, uz, vx, vy, vz, wx, wy, wz = bx - ax, by - ay, bz - az, cx - bx, cy - by, cz - bz, ax - cx, ay - cy, az - cz
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        u_scale, v_scale = 1 / max(_dot(ux, uy, uz, ux, uy, uz), TINY), 1 / max(_dot(vx, vy, vz, vx, vy, vz), TINY)
        w_scale, n_scale = 1 / max(_dot(wx, wy, wz, wx, wy, wz), TINY), 1 / max(_dot(nx, ny, nz, nx, ny, nz), TINY)
        for n in range(len(squared)):
            x, y, z = points[0, n], points[1, n], points[2, n]
            px, py, pz, qx, qy, qz, rx, ry, rz = x - ax, y - ay, z - az, x - bx, y - by, z - bz, x - cx, y - cy, z - cz
            t = min(max(_dot(px, py, pz, ux, uy, uz) * u_scale, 0.0), 1.0)
            to_u = (px - t * ux) ** 2 + (py - t * uy) ** 2 + (pz - t * uz) ** 2
            t = min(max(_dot(qx, qy, qz, vx, vy, vz) * v_scale, 0.0), 1.0)
            to_v = (qx - t * vx) ** 2 + (qy - t * vy) ** 2 + (qz - t * vz) ** 2
            t = min(max(_dot(rx, ry, rz, wx, wy, wz) * w_scale, 0.0), 1.0)
            to_w = (rx - t * wx) ** 2 + (ry - t * wy) ** 2 + (rz - t * wz) ** 2
            side_u = nx * (uy * pz - uz * py) + ny * (uz * px - ux * pz) + nz * (ux * py - uy * px)
            side_v = nx * (vy * qz - vz * qy) + ny * (vz * qx - vx * qz) + nz * (vx * qy - vy * qx)
            side_w = nx * (wy * rz - wz * ry) + ny * (wz * rx - wx * rz) + nz * (wx * ry - wy * rx)
            height = _dot(px, py, pz, nx, ny, nz)
            least = height * height * n_scale if min(min(side_u, side_v), side_w) > 0 else min(min(to_u, to_v), to_w)
            nearer = least < squared[n]
            squared[n] = least if nearer else squared[n]
            number[n] = item if nearer else number[n]


@compiled
def _nearest_on_face(corners: Array, face: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Compute the point of a face nearest to another (Ericson, Real-Time Collision Detection, 2005, 5.1.5)."""
    ax, ay, az = corners[face, 0]
    bx, by, bz = corners[face, 1]
    cx, cy, cz = corners[face, 2]
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    u_a, v_a = _dot(ux, uy, uz, x - ax, y - ay, z - az), _dot(vx, vy, vz, x - ax, y - ay, z - az)
    u_b, v_b = _dot(ux, uy, uz, x - bx, y - by, z - bz), _dot(vx, vy, vz, x - bx, y - by, z - bz)
    u_c, v_c = _dot(ux, uy, uz, x - cx, y - cy, z - cz), _dot(vx, vy, vz, x - cx, y - cy, z - cz)
    a_share, b_share, c_share = u_b * v_c - u_c * v_b, u_c * v_a - u_a * v_c, u_a * v_b - u_b * v_a
    if u_a <= 0 and v_a <= 0:
        return ax, ay, az
    if u_b >= 0 and v_b <= u_b:
        return bx, by, bz
    if c_share <= 0 and u_a >= 0 and u_b <= 0 and u_a > u_b:
        t = u_a / (u_a - u_b)
        return ax + t * ux, ay + t * uy, az + t * uz
    if v_c >= 0 and u_c <= v_c:
        return cx, cy, cz
    if b_share <= 0 and v_a >= 0 and v_c <= 0:
        t = v_a / (v_a - v_c)
        return ax + t * vx, ay + t * vy, az + t * vz
    if a_share <= 0 and v_b >= u_b and u_c >= v_c:
        t = (v_b - u_b) / ((v_b - u_b) + (u_c - v_c))
        return bx + t * (cx - bx), by + t * (cy - by), bz + t * (cz - bz)
    scale = 1 / (a_share + b_share + c_share)
    v, w = b_share * scale, c_share * scale
    return ax + ux * v + vx * w, ay + uy * v + vy * w, az + uz * v + vz * w


@compiled
def _dot(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    return ax * bx + ay * by + az * bz
