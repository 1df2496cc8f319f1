"""Polygons of COLLADA files, which pycollada cuts into fans, also concave ones."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from pipeline.formats.mesh_parts import check_corners, read_numbers
from pipeline.formats.polygons import is_concave, triangulate

POLYGONS = re.compile(rb"<(polylist|polygons)\b([^>]*)>(.*?)</\1>", re.DOTALL)
VERTICES = re.compile(rb"<vertices\b([^>]*)>(.*?)</vertices>", re.DOTALL)
INPUT = re.compile(rb"<input\b[^>]*>")
CORNERS = re.compile(rb"<p>([^<]*)</p>")
SIZES = re.compile(rb"<vcount>([^<]*)</vcount>")
POSITIONS = rb"<source\b[^>]*\bid\s*=\s*[\"']%s[\"'].*?<float_array\b[^>]*>([^<]*)<.*?<accessor\b([^>]*)"
"""The numbers of a source, and the attributes of its accessor."""


def cut_concave(content: bytes) -> bytes:
    """Write the polygons of a COLLADA file as triangles where one of them is concave; those that are not understood stay."""
    sources = {_attribute(vertices[1], b"id"): _source(vertices[2], b"POSITION") for vertices in VERTICES.finditer(content)}

    def rewrite(polygons: re.Match[bytes]) -> bytes:
        inputs, numbers = INPUT.findall(polygons[3]), CORNERS.findall(polygons[3])
        offsets = [int(_attribute(given, b"offset") or 0) for given in inputs]
        vertices = _positions(content, sources.get(_source(polygons[3], b"VERTEX"), b""))
        if vertices is None or not numbers:
            return polygons[0]
        stride = max(offsets) + 1
        corners = read_numbers(b" ".join(numbers)).astype(np.int64).reshape(-1, stride)
        counts = SIZES.search(polygons[3])
        sizes = read_numbers(counts[1]).astype(np.int64) if counts else np.array([len(text.split()) // stride for text in numbers])
        column = next(offset for offset, given in zip(offsets, inputs, strict=True) if _attribute(given, b"semantic") == b"VERTEX")
        check_corners(corners[:, column], len(vertices))
        if sizes.sum() != len(corners) or not _any_concave(corners[:, column], sizes, vertices):
            return polygons[0]
        triangles, _ = triangulate(corners[:, column], sizes, vertices)
        listed = " ".join(map(str, corners[triangles].ravel().tolist())).encode()
        attributes = re.sub(rb"\bcount\s*=\s*[\"'][^\"']*[\"']", b"", polygons[2])
        return b'<triangles count="%d"%s>%s<p>%s</p></triangles>' % (len(triangles), attributes, b"".join(inputs), listed)

    return POLYGONS.sub(rewrite, content)


def _any_concave(corners: NDArray[np.int64], sizes: NDArray[np.int64], vertices: NDArray[np.float64]) -> bool:
    firsts = np.cumsum(sizes) - sizes
    several = ((firsts[sizes == size, None] + np.arange(size)) for size in np.unique(sizes[sizes > 3]))
    return any(bool(is_concave(vertices[corners[places]]).any()) for places in several)


def _positions(content: bytes, source: bytes) -> NDArray[np.float64] | None:
    """Read the positions (V, 3) of a source; None where there is none of this name."""
    found = re.search(POSITIONS % re.escape(source), content, re.DOTALL) if source else None
    return None if found is None else read_numbers(found[1]).reshape(-1, int(_attribute(found[2], b"stride") or 1))[:, :3]


def _source(text: bytes, semantic: bytes) -> bytes:
    """Return the id of the source of the input with a semantic."""
    named = (_attribute(given, b"source") for given in INPUT.findall(text) if _attribute(given, b"semantic") == semantic)
    return next(named, b"").removeprefix(b"#")


def _attribute(text: bytes, name: bytes) -> bytes:
    found = re.search(rb"\b" + name + rb"\s*=\s*[\"']([^\"']*)", text)
    return found[1] if found else b""
