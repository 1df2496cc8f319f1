"""Settings: every knob with its default, its reason, and whether it changes results or only speed."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """A frozen set of knobs; an unknown key is an error. A stage's settings derive from it, each field made by `knob`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def results(self) -> dict[str, Any]:
        """The knobs that change results, as plain values: they belong to a stage's key."""
        return self._that_change("results")

    def speed(self) -> dict[str, Any]:
        """The knobs that change nothing but speed."""
        return self._that_change("speed")

    def _that_change(self, what: str) -> dict[str, Any]:
        return {name: value for name, value in self.model_dump(mode="json").items() if self.changes(name) == what}

    @classmethod
    def changes(cls, name: str) -> str:
        """What the knob called `name` changes: "results" or "speed"."""
        extra = cls.model_fields[name].json_schema_extra
        return str(extra["changes"]) if isinstance(extra, dict) else "results"


def knob(default: Any, reason: str, *, changes: Literal["results", "speed"] = "results", **limits: Any) -> Any:
    """A settings field: its default, why that is the default, what it changes, and limits as pydantic's `Field` takes them."""
    return Field(default, description=reason, json_schema_extra={"changes": changes}, **limits)
