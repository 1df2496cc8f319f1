"""The triangles that a glTF file shows: poses and instances of nodes, morph targets at their default weights, skins.

By glTF 2.0, sections 3.5 and 3.7, and EXT_mesh_gpu_instancing.
"""

from collections.abc import Iterator

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.gltf import SURFACES, TRIANGLES, Document, GltfPrimitive, foreign_extensions, list_of, one_line, table
from pipeline.formats.gltf_look import Looks
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import MAX_INSTANCES, check_count, check_mesh, mirrors, pose_matrix, posed
from pipeline.formats.textures import Textures
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.geometry.transforms import compose, transform_points

REST = {"TRANSLATION": (0.0, 0.0, 0.0), "ROTATION": (0.0, 0.0, 0.0, 1.0), "SCALE": (1.0, 1.0, 1.0)}
"""The parts of the pose of a node or an instance, each with its default."""


def read_gltf(file: Companions, textures: Textures) -> Iterator[Mesh]:
    """Read the surfaces of the scene that a glTF file shows, each in its pose, m, y up; list what is skipped as unread."""
    document = Document(file.file_name, file.content, file.get)
    file.unread += [f"its extension {name} is not read" for name in foreign_extensions(document.tree, "extensionsUsed")]
    nodes = _Nodes(document, Looks(document, textures), file.unread)
    for number in nodes.shown:
        poses, skin = nodes.poses(number), nodes.skin(number)
        for primitive, points, look in nodes.parts(number):
            check_count("instances of a mesh", len(poses), MAX_INSTANCES, "merge them")
            check_mesh(len(poses) * len(primitive.faces), len(poses) * len(points))
            faces = primitive.faces
            if skin is not None:
                points = _deform(points, primitive, skin)
                faces = faces[:, ::-1] if mirrors(skin).all() else faces
            for pose in poses:
                vertices, turned = posed(pose, points, faces)
                yield Mesh(vertices, turned.astype(np.int32), look)


def _deform(points: Array, primitive: GltfPrimitive, skin: Array) -> Array:
    """Move points (V, 3) by the matrices (J, 4, 4) of their joints, weighted."""
    sets = [name.removeprefix("JOINTS") for name in sorted(primitive.attributes) if name.startswith("JOINTS_")]
    if not sets:
        raise InvalidInput("a skinned mesh of it has a part without joints; weight all parts, or apply the armature")
    joints = np.concatenate([primitive.stored(f"JOINTS{number}", 4) for number in sets], axis=1)
    weights = np.concatenate([primitive.read(f"WEIGHTS{number}", 4) for number in sets], axis=1)
    joints = np.where(weights != 0, joints, joints[:, :1])  # joints without weight may be none
    if joints.dtype.kind != "u" or joints.max(initial=0) >= len(skin):
        raise InvalidInput(f"its vertices name joints outside 0..{len(skin) - 1} of their skin; export it again")
    weights[weights.sum(axis=1) <= 0, 0] = 1  # engines let such vertices follow their first joint, and scale weights to the sum 1
    weights /= weights.sum(axis=1, keepdims=True)
    moved = np.zeros_like(points)
    for joint, weight in zip(joints.T, weights.T, strict=True):
        moved += weight[:, None] * transform_points(skin[joint], points[:, None])[:, 0]
    return moved


class _Nodes:
    """The nodes of a document with their poses in the world; `shown` lists those of the scene that it shows."""

    def __init__(self, document: Document, looks: Looks, unread: list[str]) -> None:
        self._document, self._looks, self._unread, tree = document, looks, unread, document.tree
        self._parts: dict[tuple[int, bytes], list[tuple[GltfPrimitive, Array, Look]]] = {}
        if not list_of(tree, "nodes"):  # a library of meshes
            tree["nodes"] = [{"mesh": number} for number in range(len(list_of(tree, "meshes")))]
        self._nodes = [document.entry("nodes", number) for number in range(len(tree["nodes"]))]
        self._children = [list_of(node, "children") for node in self._nodes]
        roots = self._place()
        if list_of(tree, "scenes"):
            roots = list_of(document.entry("scenes", tree.get("scene", 0)), "nodes")
        self.shown = self._below(roots)
        hidden = set(range(len(self._nodes))) - set(self.shown)
        if lost := sum("mesh" in self._nodes[number] for number in hidden):
            unread.append(f"{lost} of its nodes with a mesh are skipped: they are hidden, or not in the scene that it shows")

    def parts(self, number: int) -> list[tuple[GltfPrimitive, Array, Look]]:
        """Read the surfaces of a node's mesh, once for all nodes that have it: their points (V, 3) before any pose, and looks."""
        node = self._nodes[number]
        if "mesh" not in node:
            return []
        mesh = self._document.entry("meshes", node["mesh"])
        weights = np.array(node.get("weights") or mesh.get("weights") or (), np.float64)
        key = node["mesh"], weights.tobytes()
        if key not in self._parts:
            entries = list_of(mesh, "primitives")
            surfaces = [entry for entry in entries if entry.get("mode", TRIANGLES) in SURFACES]
            if len(surfaces) < len(entries):
                self._unread.append(f"points and lines of mesh {one_line(mesh.get('name', node['mesh']))} are not read")
            primitives = [GltfPrimitive(self._document, entry, weights) for entry in surfaces]
            self._parts[key] = [(part, part.read("POSITION", 3), self._looks.look(part)) for part in primitives]
        return self._parts[key]

    def poses(self, number: int) -> Array:
        """Compute the poses of a node's mesh, (I, 4, 4): one, or those of its instances; the world's origin if it has a skin."""
        node = self._nodes[number]
        instancing = table(table(node, "extensions"), "EXT_mesh_gpu_instancing")
        if "skin" in node:
            if instancing:
                raise InvalidInput("a skinned mesh of it has instances, which glTF does not define; apply them before you export it")
            return np.eye(4)[None]
        numbers = table(instancing, "attributes")
        arrays = {name: self._document.array(numbers[name], len(default)) for name, default in REST.items() if name in numbers}
        if not arrays:
            return self._world[number][None]
        if len({len(array) for array in arrays.values()}) > 1:
            raise InvalidInput("instances of a mesh have different numbers of positions, rotations and scales; export it again")
        instances = pose_matrix(*(arrays.get(name, default) for name, default in REST.items()))
        return compose(self._world[number], instances)

    def skin(self, number: int) -> Array | None:
        """Compute the matrices (J, 4, 4) by which the joints of a node's skin move its vertices; None without one."""
        if "skin" not in self._nodes[number]:
            return None
        skin = self._document.entry("skins", self._nodes[number]["skin"])
        joints = list_of(skin, "joints")
        for joint in joints:
            self._document.entry("nodes", joint)
        matrices = np.stack([self._world[joint] for joint in joints])
        if "inverseBindMatrices" not in skin:
            return matrices
        inverse = self._document.array(skin["inverseBindMatrices"], 16)[: len(joints)].astype(np.float64).reshape(-1, 4, 4)
        if len(inverse) < len(joints):
            raise InvalidInput(f"a skin of it has {len(joints)} joints and {len(inverse)} inverse bind matrices; export it again")
        return compose(matrices, np.swapaxes(inverse, 1, 2))  # columns first

    def _place(self) -> list[int]:
        """Compute the poses of all nodes, parents before their children; return those without a parent."""
        parents = {child: number for number, children in enumerate(self._children) for child in children}
        if len(parents) < sum(map(len, self._children)):
            raise InvalidInput("a node of it has two parents; export it again")
        roots = [number for number in range(len(self._nodes)) if number not in parents]
        self._world = dict[int, Array]()
        waiting = list(roots)
        for number in waiting:
            node = self._document.entry("nodes", number)
            if "matrix" in node:
                pose = np.array(node["matrix"], np.float64).reshape(4, 4).T
            else:
                pose = pose_matrix(*(node.get(name.lower(), default) for name, default in REST.items()))
            self._world[number] = compose(self._world[parents[number]], pose) if number in parents else pose
            waiting += self._children[number]
        if len(self._world) < len(self._nodes):
            raise InvalidInput("a node of it is its own ancestor; export it again")
        return roots

    def _below(self, roots: list[int]) -> list[int]:
        """List nodes and their descendants, each once, without hidden ones (KHR_node_visibility)."""
        shown, waiting = dict[int, None](), list(reversed(roots))
        while waiting:
            number = waiting.pop()
            node = self._document.entry("nodes", number)
            if number not in shown and table(table(node, "extensions"), "KHR_node_visibility").get("visible", True):
                shown[number] = None
                waiting += reversed(self._children[number])
        return list(shown)
