"""Say in one line what is wrong with the entries of a file or the settings of a stage."""

from __future__ import annotations

from collections.abc import Collection
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError


def complaints(error: ValidationError, names: Collection[str] = ()) -> str:
    """Name every entry that cannot be used, with the reason; of `names`, those of the entries there are, the one that was meant."""
    found: list[Any] = error.errors()
    places = [item["loc"] for item in found]
    meant = {item["loc"]: _meant(item["loc"][-1], names) for item in found if item["type"] == "extra_forbidden"}
    misspelt = {(*place[:-1], name) for place, name in meant.items()}
    said = []
    for item in found:
        place = item["loc"]
        inside = any(other[: len(place)] == place and other != place for other in places)
        if place in misspelt or (item["type"] == "too_short" and inside):  # both follow from what another complaint names
            continue
        said.append(_complaint(item["type"], ".".join(map(str, place)), item["msg"], meant.get(place)))
    return "; ".join(said)


def entry_names(model: type[BaseModel]) -> set[str]:
    """The names of all entries of a model and of the models in it."""
    schema = model.model_json_schema()
    return {name for one in (schema, *schema.get("$defs", {}).values()) for name in one.get("properties", {})}


def _meant(name: object, names: Collection[str]) -> str | None:
    return next(iter(get_close_matches(str(name), names, n=1, cutoff=0.7)), None)


def _complaint(kind: str, name: str, message: str, meant: str | None) -> str:
    if kind == "extra_forbidden":
        return f"there is no entry {name}" + (f", did you mean {meant}?" if meant else "")
    if kind == "missing":
        return f"entry {name} is missing"
    message = message.removeprefix("Value error, ")
    return f"{name}: {message}" if name else message
