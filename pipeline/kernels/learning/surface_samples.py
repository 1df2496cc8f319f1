"""Points drawn area-uniformly from triangle surfaces, differentiable in the vertices."""

from __future__ import annotations

import torch
from torch import Tensor


def sample_surface(vertices: Tensor, faces: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """Draw points from a surface, (count, 3), in the vertices' unit.

    Every place is equally likely, so a face without area is never chosen. A point is a fixed mixture of its face's corners:
    gradients reach the vertices through it, not through the choice of the face (as in Smith et al., GEOMetrics, 2019).
    The result depends on the generator's state and the arguments alone.

    Parameters
    ----------
    vertices
        (V, 3) floating.
    faces
        (F, 3) int64, rows of `vertices`.
    count
        Points to draw, at least 1.
    generator
        A CPU generator, wherever the vertices lie.

    Raises
    ------
    ValueError
        Wrong shapes, a vertex that is NaN or infinite, a count below 1, or no face with an area.
    """
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"vertices have shape {tuple(vertices.shape)}, faces {tuple(faces.shape)}; they must be (V, 3) and (F, 3)")
    return sample_surfaces(vertices[None], faces, count, generator)[0]


def sample_surfaces(vertices: Tensor, faces: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """As `sample_surface` for surfaces that share their faces: `vertices` (B, V, 3), `faces` (F, 3) to (B, count, 3)."""
    if count < 1:
        raise ValueError(f"{count} points asked for; at least 1 is drawn")
    uniform = torch.rand(len(vertices), count, 3, generator=generator, dtype=torch.float64)
    return surface_points(vertices, faces, uniform)


def surface_points(vertices: Tensor, faces: Tensor, uniform: Tensor) -> Tensor:
    """Map the unit cube to surfaces, volume to area: `vertices` (B, V, 3), `faces` (F, 3), `uniform` (B, n, 3) to (B, n, 3).

    The first coordinate of `uniform`, in [0, 1) float64, chooses the face by its share of the area; the others, u and v,
    the point (1 - √u) A + √u (1 - v) B + √u v C in it (Osada et al., Shape Distributions, 2002). No row depends on another.
    """
    _check(vertices, faces, uniform)
    with torch.no_grad():
        chosen = _choose(_cumulative_areas(vertices, faces), uniform[..., 0].to(vertices.device))  # (B, n)
        root, along = uniform[..., 1].sqrt(), uniform[..., 2]
        weights = torch.stack([1 - root, root * (1 - along), root * along], dim=-1).to(vertices)  # (B, n, 3)
        first = torch.arange(len(vertices), device=vertices.device)[:, None, None] * vertices.shape[1]
        corners = faces.to(vertices.device)[chosen] + first  # (B, n, 3) into all vertices
    placed = vertices.reshape(-1, 3).index_select(0, corners.reshape(-1)).reshape(*corners.shape, 3)
    mixed = weights[..., 0, None] * placed[..., 0, :] + weights[..., 1, None] * placed[..., 1, :]
    return mixed + weights[..., 2, None] * placed[..., 2, :]


def _cumulative_areas(vertices: Tensor, faces: Tensor) -> Tensor:
    """(B, F) float64: twice the area of all faces up to and with each one."""
    a, b, c = vertices.detach().double()[:, faces.to(vertices.device)].unbind(dim=2)  # (B, F, 3) each
    across = torch.linalg.cross(b - a, c - a)
    doubled: Tensor = across.square().sum(dim=-1).sqrt()
    return doubled.cumsum(dim=-1)


def _choose(cumulative: Tensor, uniform: Tensor) -> Tensor:
    """(B, n) the first face whose cumulative area exceeds `uniform` of the whole: one with an area of its own."""
    total = cumulative[:, -1:]
    if not bool((total > 0).all()):
        empty = torch.nonzero(total[:, 0] <= 0)[:, 0].tolist()
        raise ValueError(f"no face of surface {empty[:5]} (of {len(total)}) has an area to draw points from")
    below = torch.nextafter(total, torch.zeros_like(total))  # rounding may reach the whole itself
    return torch.searchsorted(cumulative, torch.minimum(uniform * total, below), right=True)


def _check(vertices: Tensor, faces: Tensor, uniform: Tensor) -> None:
    if vertices.ndim != 3 or vertices.shape[2] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
        raise ValueError(f"vertices have shape {tuple(vertices.shape)}, faces {tuple(faces.shape)}; they must be (B, V, 3) and (F, 3)")
    if uniform.ndim != 3 or uniform.shape[::2] != (len(vertices), 3):
        raise ValueError(f"uniform has shape {tuple(uniform.shape)}, vertices {tuple(vertices.shape)}; uniform must be (B, n, 3)")
    if not bool(torch.isfinite(vertices).all()):
        raise ValueError(f"vertices hold NaN or infinity in {int((~torch.isfinite(vertices)).sum())} of {vertices.numel()} coordinates")
