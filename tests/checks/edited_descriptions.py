"""Shipped descriptions with changed entries, for tests."""

from pathlib import Path

import yaml

from pipeline.formats.description_file import description_path


def edited(kind: str, name: str, path: Path, **changed: object) -> Path:
    described = yaml.safe_load(description_path(kind, name).read_text())  # type: ignore[arg-type]
    path.write_text(yaml.safe_dump(described | changed))
    return path
