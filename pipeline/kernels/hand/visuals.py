"""What a hand looks like, and its rigid shapes, as triangle meshes."""

from __future__ import annotations

import numpy as np
import trimesh

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.urdf import Color, Shape

GREY: Color = (0.7, 0.7, 0.7, 1.0)
"""Colour of a visual that names none."""


def visual_meshes(hand: Hand) -> list[tuple[int, Mesh]]:
    """Every visual shape as (number of its link, mesh in that link's frame, in metres, with its colour); gels included."""
    return [(number, shape_mesh(shape)) for number, link in enumerate(hand.links) for shape in link.visuals]


def shape_mesh(shape: Shape) -> Mesh:
    """One visual or collision shape as a mesh in its link's frame, m."""
    if shape.kind == "box":
        body = trimesh.creation.box(extents=shape.size)
    elif shape.kind == "sphere":
        body = trimesh.creation.icosphere(subdivisions=3, radius=shape.size[0])
    elif shape.kind == "cylinder":
        body = trimesh.creation.cylinder(radius=shape.size[0], height=shape.size[1], sections=32)
    else:
        body = trimesh.load_mesh(shape.path)
        body.vertices = body.vertices * np.array(shape.size)
    vertices = trimesh.transform_points(body.vertices, shape.origin)
    red, green, blue, _ = (round(255 * part) for part in shape.color or GREY)
    look = Look.plain(len(vertices), len(body.faces), (red, green, blue))
    return Mesh(np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(body.faces, np.int32), look)
