"""Say in one line what is wrong with the entries of a file or the settings of a stage."""

from __future__ import annotations

from pydantic import ValidationError


def complaints(error: ValidationError) -> str:
    """Name every entry that cannot be used, with the reason."""
    return "; ".join(_complaint(item["type"], ".".join(map(str, item["loc"])), item["msg"]) for item in error.errors())


def _complaint(kind: str, name: str, message: str) -> str:
    if kind == "extra_forbidden":
        return f"there is no entry {name}"
    if kind == "missing":
        return f"entry {name} is missing"
    return f"{name}: {message}" if name else message
