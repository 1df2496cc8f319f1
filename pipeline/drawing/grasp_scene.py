"""Make a glTF scene of an object with its grasps: object, hand, gels, touched surface, touch charts and predictions as named nodes."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import fast_simplification
import numpy as np
import trimesh
import trimesh.visual
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from pipeline.dataset.grasps import grasp_count
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import is_surface
from pipeline.drawing.colors import TOUCH_COLOR, VISION_COLORS, Y_UP, Color, finger_colors, linear_colors
from pipeline.drawing.grasp_pictures import Rows, gel_squares, touch_patch
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor

OBJECT_FACES, LINK_FACES, PATCH_FACES = 6000, 80, 200
"""Most faces of an object, of each shape of a hand and of a touched patch in a small scene: as many as a screen shows."""
TEXTURED_FACES = 20_000  # most faces with which an object keeps its texture in a small scene; others get colours of vertices
GRID = 2.0**-15  # m to which coordinates are rounded in a small scene: 30 µm, which halves compressed files
TEXTURE = 512  # pixels along the longest side of a texture in a small scene, which is written as WebP
Scene = Any  # a `trimesh.Scene`, whose methods have no types
_visual: Any = trimesh.visual


class GraspScenes:
    """Make the scenes of a dataset's objects, for one hand and its sensors, one per finger.

    If `small`, meshes are simplified and coordinates rounded, for a web page; else they are as stored.
    """

    def __init__(self, hand: Hand, sensors: Sequence[Sensor], *, small: bool) -> None:
        self.hand, self.sensors, self.small = hand, sensors, small
        self._shapes = [(link, f"shape-{number}", self._shape(mesh)) for number, (link, mesh) in enumerate(hand.visual_meshes)]

    def scene(self, rows: Rows) -> Scene:
        """Make the scene of an object from its rows of `surfaces`, `grasps` and, if made, `touch` and `charts`.

        Its nodes are `object`, and per grasp K `grasp-K-hand`, `grasp-K-sensors`, `grasp-K-touched` and
        `grasp-K-charts`; m, y up as glTF is.
        """
        scene = trimesh.Scene(base_frame="world")
        for number, part in enumerate(self._object(rows["surfaces"])):
            self.add(scene, f"object-{number}", part, "object")
        for grasp in range(grasp_count(rows["grasps"])):
            self._add_grasp(scene, rows, grasp)
        return scene

    def predictions(
        self,
        surfaces: Mapping[str, tuple[np.ndarray, np.ndarray]],  # (V, 3) m, (F, 3) by name
    ) -> Scene:
        """Make a scene of predicted surfaces, whose nodes are called `prediction-NAME`."""
        scene = trimesh.Scene(base_frame="world")
        for name, (vertices, faces) in surfaces.items():
            self.add(scene, name, _plain(vertices, faces, VISION_COLORS[0][:3]), f"prediction-{name}")
        return scene

    def glb(self, scene: Scene) -> bytes:
        """Write a scene as GLB; viewers compute the normals."""
        return bytes(scene.export(file_type="glb", include_normals=False, extension_webp=self.small))

    def _add_grasp(self, scene: Scene, rows: Rows, grasp: int) -> None:
        row = rows["grasps"]
        colors = finger_colors(len(self.hand.sensors))
        frames = forward_kinematics(self.hand, row["hand_pose"][grasp], row["joint_angles"][grasp])
        for link, name, mesh in self._shapes:
            self.add(scene, name, mesh, f"grasp-{grasp}-hand", frames[link])
        for sensor, corners in enumerate(gel_squares(row["sensor_pose"][grasp], self.sensors)):
            square = _plain(corners, np.array([[0, 1, 2], [0, 2, 3]]), colors[sensor])
            self.add(scene, f"gel-{grasp}-{sensor}", square, f"grasp-{grasp}-sensors")
        for sensor in np.flatnonzero(row["touch_success"][grasp]).tolist() if "touch" in rows else ():
            depth, pose = rows["touch"]["depth"][grasp, sensor], row["sensor_pose"][grasp, sensor]
            if patch := touch_patch(depth, pose, self.sensors[sensor], colors[sensor]):
                vertices, faces = _simplified(patch.vertices, patch.faces, PATCH_FACES if self.small else len(patch.faces))
                self.add(scene, f"patch-{grasp}-{sensor}", _plain(vertices, faces, colors[sensor]), f"grasp-{grasp}-touched")
        if "charts" in rows:
            charts = rows["charts"]
            for sensor in np.flatnonzero(is_surface(charts["stop_rule"][grasp])).tolist():
                part = _plain(charts["vertices"][grasp, sensor], charts["chart_faces"], TOUCH_COLOR[:3])
                self.add(scene, f"chart-{grasp}-{sensor}", part, f"grasp-{grasp}-charts")

    def add(
        self,
        scene: Scene,
        name: str,
        mesh: trimesh.Trimesh,
        group: str,
        pose: NDArray[np.float64] | None = None,  # (4, 4) mesh to group, m; by default the identity
    ) -> None:
        """Add a mesh to a scene below the node `group`, made if missing; a mesh of the same name is shared."""
        if group not in scene.graph.transforms.nodes:  # `graph.nodes` hashes the whole graph
            scene.graph.update(frame_from="world", frame_to=group, matrix=Y_UP)
        node, matrix = f"{group}-{name}", np.eye(4) if pose is None else pose
        if name in scene.geometry:
            scene.graph.update(frame_from=group, frame_to=node, matrix=matrix, geometry=name)
            return
        if self.small and len(mesh.vertices):
            mesh.vertices = np.round(mesh.vertices / GRID) * GRID
        scene.add_geometry(mesh, node_name=node, geom_name=name, parent_node_name=group, transform=matrix)

    def _shape(self, mesh: Mesh) -> trimesh.Trimesh:
        vertices, faces = _merged(mesh)
        if self.small:
            vertices, faces = _simplified(vertices, faces, LINK_FACES, haste=3)
        return _plain(vertices, faces, tuple(mesh.look.base_color[mesh.look.face_material[0], :3].tolist()))

    def _object(self, surface: Mapping[str, np.ndarray]) -> list[trimesh.Trimesh]:
        mesh = read_mesh(surface)
        max_faces = TEXTURED_FACES if mesh.look.textures else OBJECT_FACES
        if mesh.look.vertex_color is None and (not self.small or len(mesh.faces) <= max_faces):
            side = TEXTURE if self.small else None
            return [_of_material(mesh, material, side) for material in np.unique(mesh.look.face_material)]
        vertices, faces, painted = mesh.vertices, mesh.faces, _vertex_colors(mesh)
        if self.small:
            vertices, faces = _simplified(*_merged(mesh), max_faces)
            painted = painted[cKDTree(mesh.vertices).query(vertices)[1]]
        return [trimesh.Trimesh(vertices, faces, vertex_colors=linear_colors(painted), process=False)]


def _merged(mesh: Mesh) -> tuple[NDArray[np.float64], NDArray[np.int64]]:  # (V, 3) m, (F, 3)
    """Merge coincident vertices of a mesh, so that simplifying it opens no seam."""
    vertices, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    return vertices, number.reshape(-1)[mesh.faces]


def _simplified(
    vertices: NDArray[Any],  # (V, 3) m
    faces: NDArray[Any],  # (F, 3)
    max_faces: int,
    haste: int = 7,  # less preserves shapes of many parts, with more faces
) -> tuple[NDArray[Any], NDArray[Any]]:  # (V', 3) m, (F', 3)
    """Simplify a mesh to about `max_faces` faces by quadric error."""
    if len(faces) <= max_faces:
        return vertices, faces
    simplify: Any = fast_simplification.simplify
    fewer: tuple[NDArray[Any], NDArray[Any]] = simplify(vertices.astype(np.float32), faces, target_count=max_faces, agg=haste)
    return fewer


def _of_material(mesh: Mesh, material: int, side: int | None) -> trimesh.Trimesh:
    """Take the faces of one material, with its colour and texture, this no larger than `side` pixels."""
    look, faces = mesh.look, mesh.faces[mesh.look.face_material == material]
    used_vertices, corners = np.unique(faces, return_inverse=True)
    texture, image = look.material_texture[material], None
    if texture >= 0:
        image = Image.fromarray(look.textures[texture]).convert("RGB")
        if side is not None:
            image.thumbnail((side, side))
    surface = _visual.material.PBRMaterial(
        baseColorFactor=linear_colors(look.base_color[material][None])[0],
        baseColorTexture=image,
        metallicFactor=0.0,
        roughnessFactor=0.7,
        doubleSided=True,
    )
    visual = _visual.TextureVisuals(uv=look.uv[used_vertices] if image else None, material=surface)
    return trimesh.Trimesh(mesh.vertices[used_vertices], corners.reshape(-1, 3), visual=visual, process=False)


def _vertex_colors(mesh: Mesh) -> NDArray[np.uint8]:  # (V, 4) sRGB
    """Look up the colour of every vertex, in the material of one of its faces."""
    look = mesh.look
    material = np.zeros(len(mesh.vertices), int)
    material[mesh.faces] = look.face_material[:, None]
    colors = look.base_color[material].astype(float)
    for number, texture in enumerate(look.textures):
        painted = look.material_texture[material] == number
        rows, cols = texture.shape[:2]
        u, v = (look.uv[painted] % 1).T
        colors[painted] *= texture[((1 - v) * (rows - 1)).astype(int), (u * (cols - 1)).astype(int)] / 255
    if look.vertex_color is not None:
        colors *= look.vertex_color / 255
    return colors.astype(np.uint8)


def _plain(vertices: np.ndarray, faces: np.ndarray, color: Color) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices, faces, visual=_visual.TextureVisuals(material=_material(color)), process=False)


@lru_cache(maxsize=64)
def _material(color: Color) -> Any:
    factor = linear_colors(np.array([[*color, 255]], np.uint8))[0]
    return _visual.material.PBRMaterial(baseColorFactor=factor, metallicFactor=0.0, roughnessFactor=0.8, doubleSided=True)
