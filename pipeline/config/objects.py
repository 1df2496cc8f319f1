"""The objects of a dataset: the source of each, and digests of it."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import refuse_pointer
from pipeline.formats.mesh_companions import Companions


@dataclass(frozen=True)
class Object:
    """An object of a dataset."""

    object_id: str
    category: str
    source: dict[str, Any]  # how to load it: JSON values; `file` is a path
    split: str = ""  # that the manifest draws


def fingerprint(source: dict[str, Any]) -> dict[str, Any]:
    """Describe an object's source independently of where its files lie: a file is replaced by the hash of its content.

    The materials and textures that it names count too; renderings, which belong to another stage's key, and the licence
    do not.
    """
    description = {name: value for name, value in source.items() if name not in ("root", "renderings", "licence")}
    if "file" not in source:
        return description
    companions = Companions(Path(source["file"]), Path(source["root"]))
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in companions.items()}
    return {**description, "file": {"sha256": companions.sha256, "companions": digests}}


def checksum(objects: list[Object]) -> str:
    """Compute one SHA-256 for all files of a source, of the lines `ID SHA256` in id order."""
    files = sorted((item.object_id, Path(item.source["file"])) for item in objects if "file" in item.source)
    return hashlib.sha256("".join(f"{name} {file_checksum(file)}\n" for name, file in files).encode()).hexdigest()


def file_checksum(file: Path) -> str:
    """Compute the SHA-256 of a mesh file."""
    if not file.is_file():
        raise InvalidInput(f"{file} is no regular file; remove it")
    content = file.read_bytes()
    refuse_pointer(file, content)
    return hashlib.sha256(content).hexdigest()
