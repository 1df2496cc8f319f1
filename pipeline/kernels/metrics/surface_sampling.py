"""Points drawn area-uniformly from triangle surfaces, differentiable in the vertices.

Faces are chosen by areas in float64; points are computed in the vertices' type, and lie within 4 units in the last place of the largest
coordinate of where they would be without rounding: in float32 0.3 µm at 0.6 m. Surfaces are finite, from 1 µm to 1 km large; faces may be
slivers, segments or points, and those without area are never chosen.
"""

import math

import torch
from torch import Tensor

from pipeline.errors import InvalidInput


def sample_surface(vertices: Tensor, faces: Tensor, count: int, generator: torch.Generator) -> Tensor:  # (count, 3)
    """Draw points from a surface (V, 3), (F, 3), differentiable but for the choice of faces (Smith et al., GEOMetrics, 2019)."""
    return map_to_surface(vertices, faces, torch.rand(count, 3, generator=generator, dtype=torch.float64))


def map_to_surface(vertices: Tensor, faces: Tensor, uniform: Tensor) -> Tensor:  # (n, 3), the vertices' unit and type
    """Map the unit cube, `uniform` (n, 3) float64, to a surface of vertices (V, 3) and faces (F, 3) int64, volume to area.

    The first coordinate chooses the face by its share of the area; the others, u and v, the point
    (1 - √u) A + √u (1 - v) B + √u v C in it (Osada et al., Shape Distributions, 2002).
    """
    if not bool(torch.isfinite(vertices).all()):
        raise InvalidInput(f"vertices hold NaN or infinity in {int((~torch.isfinite(vertices)).sum())} of {vertices.numel()} coordinates")
    with torch.no_grad():
        faces, uniform = faces.to(vertices.device), uniform.to(vertices.device)
        face = _choose(doubled_areas(vertices.double(), faces).cumsum(dim=0), uniform[:, 0])  # (n,)
        root, along = uniform[:, 1].sqrt(), uniform[:, 2]
        u, v, w = (weight[:, None].to(vertices) for weight in (1 - root, root * (1 - along), root * along))
    a, b, c = vertices.index_select(0, faces[face].reshape(-1)).reshape(-1, 3, 3).unbind(dim=1)
    return u * a + v * b + w * c


def doubled_areas(vertices: Tensor, faces: Tensor) -> Tensor:
    """Compute twice the areas (F,) of faces (F, 3) of vertices (V, 3): exactly 0 where two corners are one.

    By components: torch's cross product fuses multiplications and additions, which leaves such faces a rounding error for an area.
    """
    a, b, c = vertices[faces].unbind(dim=1)  # (F, 3) each
    (x, y, z), (u, v, w) = (b - a).unbind(dim=1), (c - a).unbind(dim=1)
    return ((y * w - z * v).square() + (z * u - x * w).square() + (x * v - y * u).square()).sqrt()


def _choose(cumulative: Tensor, uniform: Tensor) -> Tensor:
    """Find the first faces (n,) whose cumulative area (F,) exceeds `uniform` (n,) of the whole: ones with an area."""
    total = cumulative[-1]
    if not 0 < float(total) < math.inf:
        raise InvalidInput(f"the surface's area is {float(total) / 2:g}: no face has a finite area above 0 to draw points from")
    below = torch.nextafter(total, torch.zeros_like(total))  # rounding may reach the whole itself
    return torch.searchsorted(cumulative, torch.minimum(uniform * total, below), right=True)


def edge_length(vertices: Tensor, edges: Tensor) -> Tensor:
    """Compute the mean squared length of edges (E, 2), in the vertices' unit squared: (B,)."""
    first, second = vertices[:, edges].unbind(dim=2)
    return (first - second).square().sum(dim=-1).mean(dim=-1)
