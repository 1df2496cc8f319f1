"""A mesh as the arrays of a row of `surfaces`, and back."""

import fnmatch
from collections.abc import Mapping

import numpy as np

from pipeline.kernels.geometry.mesh import Look, Mesh


def read_mesh(view: Mapping[str, np.ndarray]) -> Mesh:
    """Read the normalised mesh from a row of `surfaces`."""
    names = list(view)
    textures = fnmatch.filter(names, "meshes/texture_*")
    look = Look(
        uv=view["meshes/uv"],
        face_material=view["meshes/face_material"],
        base_color=view["meshes/base_color"],
        material_texture=view["meshes/material_texture"],
        textures=tuple(view[f"meshes/texture_{number}"] for number in range(len(textures))),
        vertex_color=view["meshes/vertex_color"] if "meshes/vertex_color" in names else None,
    )
    return Mesh(view["meshes/vertices"], view["meshes/faces"], look)


def mesh_row(mesh: Mesh) -> dict[str, np.ndarray]:
    """Make the part of a row of `surfaces` that holds a mesh: `read_mesh` reads it back."""
    colors = {} if mesh.look.vertex_color is None else {"meshes/vertex_color": mesh.look.vertex_color}
    return {
        "meshes/vertices": mesh.vertices,
        "meshes/faces": mesh.faces,
        "meshes/uv": mesh.look.uv,
        "meshes/face_material": mesh.look.face_material,
        "meshes/base_color": mesh.look.base_color,
        "meshes/material_texture": mesh.look.material_texture,
        **{f"meshes/texture_{number}": texture for number, texture in enumerate(mesh.look.textures)},
        **colors,
    }
