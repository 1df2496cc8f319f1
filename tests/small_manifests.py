"""Manifests of a source or two, and a mesh to put in their folders, for tests."""

from pathlib import Path

from pipeline.config.manifest import Manifest

CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def manifest(*sources: dict, splits: dict | None = None) -> Manifest:
    splits = splits or {"train": 0.5, "valid": 0.25, "test": 0.25}
    return Manifest.model_validate({"name": "m", "description": "d", "seed": 0, "splits": splits, "sources": sources})


def folder(kind: str, path: Path | None = None, **more: object) -> dict:
    return {"kind": kind, "licence": "x", "up": "y", "path": path} | more
