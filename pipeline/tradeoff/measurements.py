"""Measured costs and errors of settings: what `make tradeoff` wrote, and the code that it was measured on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

from pydantic import TypeAdapter

from pipeline.config.settings import Settings
from pipeline.engine.keys import code_hash
from stages.registry import load_stage

ASSET = "tradeoff.json"
TIE_TOLERANCE = {"seconds": 0.2, "kilobytes": 0.02, "error": 0.02}
"""Relative differences up to which two values count as equal: times are noisy, the others nearly not."""


@dataclass(frozen=True)
class Provenance:
    """Where figures come from.

    Attributes
    ----------
    command, commit, machine, date
        Of the measurement.
    code
        `code_hash` of the measured stage; None where it was not recorded.
    """

    command: str
    commit: str
    machine: str
    date: str
    code: str | None = None


@dataclass(frozen=True)
class Measurement:
    """The cost and error of a stage at one set of settings.

    Attributes
    ----------
    label
        What was set; presets of the same settings share a measurement: "draft, standard".
    kind
        "preset", "setting" (one varied), "combination" (several varied) or "seed" (none varied).
    settings
        All settings that change results, without those that define what is asked for.
    seconds, kilobytes
        On one core: of one object, or of the whole dataset where the stage processes it as one.
    figures
        By name with unit; the first is the error.
    bound
        Upper bound, with 95 % confidence, of the error on another dataset of the same kind.
    """

    label: str
    kind: str
    settings: Mapping[str, Any]
    seconds: float
    kilobytes: float
    figures: Mapping[str, float]
    bound: float

    @property
    def error(self) -> float:
        """The first figure."""
        return next(iter(self.figures.values()))

    def is_preset(self, name: str) -> bool:
        """Whether these are the settings of a preset."""
        return self.kind == "preset" and name in self.label.split(", ")

    def dominates(self, other: Measurement, costs: tuple[str, ...]) -> bool:
        """Whether it is better than `other` in some cost or in error, and worse in none, beyond `TIE_TOLERANCE`."""
        pairs = [(getattr(self, name), getattr(other, name), TIE_TOLERANCE[name]) for name in (*costs, "error")]
        no_worse = all(ours <= theirs * (1 + tolerance) for ours, theirs, tolerance in pairs)
        return no_worse and any(ours < theirs * (1 - tolerance) for ours, theirs, tolerance in pairs)


@dataclass(frozen=True)
class Study:
    """Measurements of one stage, on the same objects.

    Attributes
    ----------
    name, stage
        A stage may have several studies: "train-gcn" and "train-gcn seeing".
    objects
        Number of objects it was measured on; for a training, those that it learned from.
    whole_dataset
        Whether the stage processes the dataset as one, so that seconds are those of all objects.
    costs
        Fields of `Measurement` that count as cost: "seconds", or "kilobytes" too.
    provenance
        Where the figures come from.
    measurements
        At least one.
    fixed
        Settings of all measurements that define what is asked for: which network is trained, for instance.
    varied_at
        Settings, other than the preset's, at which single settings were varied.
    skipped
        Presets that were not measured, with the reason.
    """

    name: str
    stage: str
    objects: int
    whole_dataset: bool
    costs: tuple[str, ...]
    provenance: Provenance
    measurements: tuple[Measurement, ...]
    fixed: Mapping[str, Any] = field(default_factory=dict)
    varied_at: Mapping[str, Any] = field(default_factory=dict)
    skipped: Mapping[str, str] = field(default_factory=dict)

    @property
    def metric(self) -> str:
        """Name of the error, with its unit."""
        return next(iter(self.measurements[0].figures))

    @property
    def unit(self) -> str:
        """Unit of the error; empty for a number without one."""
        return self.metric.rpartition(", ")[2] if ", " in self.metric else ""

    @property
    def choices(self) -> list[Measurement]:
        """The measurements that a user can choose among: not those of other seeds."""
        return [one for one in self.measurements if one.kind != "seed"]

    def front(self) -> list[Measurement]:
        """Find the measurements that no other dominates, in order of seconds."""
        best = [one for one in self.choices if not any(other.dominates(one, self.costs) for other in self.choices)]
        return sorted(best, key=lambda one: one.seconds)

    def at(self, settings: Settings) -> Measurement | None:
        """Find the measurement at these settings; settings that define what is asked for may differ."""
        wanted = settings.accuracy()
        return next((one for one in self.choices if one.settings == wanted), None)

    def fixed_otherwise(self, settings: Settings) -> str:
        """Name the `fixed` settings that differ from the given ones, as ", with NAME=VALUE"; empty where none does."""
        given = settings.model_dump(mode="json")
        return "".join(f", with {name}={value}" for name, value in self.fixed.items() if given[name] != value)

    def is_current(self) -> bool:
        """Whether the stage's code is still the measured code."""
        return self.provenance.code == code_hash(load_stage(self.stage))

    def source(self) -> str:
        """Say from which commit the figures are, and whether the code has changed since."""
        changed = "" if self.is_current() else "; the code has changed since"
        return f"commit {self.provenance.commit}, {self.provenance.date}{changed}"


@cache
def load_studies() -> dict[str, Study]:
    """Load every study by name, in the order of the stages."""
    entries = json.loads(resources.files("pipeline.tradeoff").joinpath(ASSET).read_text())["studies"]
    return TypeAdapter(dict[str, Study]).validate_python({name: {"name": name, **entry} for name, entry in entries.items()})
