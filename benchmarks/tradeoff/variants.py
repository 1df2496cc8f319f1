"""What is tried of each stage: `sweep.yaml`, and from it one variant a setting."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import yaml

from pipeline.config.presets import load_presets, resolve
from pipeline.config.settings import Settings
from stages.registry import STAGES, load_stage

HERE = Path(__file__).parent
Kind = Literal["preset", "setting", "together", "reference", "seed"]
ANOTHER_SEED = 1_000
"""Of references: points drawn alike would agree with each other better than with the surface."""
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Variant:
    """A stage at one setting: a preset, and what is set on top of it. A `Study` has several."""

    kind: Kind
    label: str
    preset: str
    values: Values = field(default_factory=dict)
    seed: int | None = None

    def assignments(self, stage: str) -> list[str]:
        """The values as `--set` takes them."""
        return [f"{stage}.{setting}={_as_text(value)}" for setting, value in self.values.items()]

    def settings(self, stage: str) -> Settings:
        """All settings of the stage."""
        return resolve(load_stage(stage), self.preset, self.assignments(stage), STAGES)


@dataclass(frozen=True)
class Study:
    """The variants of a stage, as `sweep.yaml` describes them.

    Attributes
    ----------
    name, stage
        A stage may have several studies: "train-gcn" and "train-gcn seeing".
    objects
        The manifest, beside this file, that it is measured on.
    base
        The preset from which single settings are varied.
    beside
        What stands beside a single setting: settings at which its error shows.
    always
        What every variant sets: which network is trained, for instance.
    skip
        Presets that are not measured as wholes, and why.
    seeds
        Other seeds, at the base's settings: what differs by less than these do is noise.
    costs
        What a setting costs: "seconds", or "kilobytes" too.
    """

    name: str
    stage: str
    objects: str
    base: str
    settings: Mapping[str, list[Any]]
    together: list[Values] = field(default_factory=list)
    reference: Values | None = None
    beside: Values = field(default_factory=dict)
    always: Values = field(default_factory=dict)
    skip: Mapping[str, str] = field(default_factory=dict)
    seeds: tuple[int, ...] = ()
    costs: tuple[str, ...] = ("seconds",)

    @property
    def manifest(self) -> Path:
        """The manifest's file."""
        return HERE / f"{self.objects}.yaml"

    def variants(self) -> list[Variant]:
        """Presets, single settings, several settings, other seeds; settings that come twice are tried once."""
        found: dict[str, Variant] = {}
        for variant in self._all():
            same = found.setdefault(self._key(variant), variant)
            if same is not variant and same.kind == variant.kind == "preset":
                found[self._key(variant)] = replace(same, label=f"{same.label}, {variant.label}")
        if len({one.label for one in found.values()}) < len(found):
            raise ValueError(f"{self.name}: two variants have one label, and would be made in one directory")
        return list(found.values())

    def against(self) -> Variant | None:
        """What errors are measured against; None where the error needs nothing."""
        if self.reference is None:
            return None
        return Variant("reference", "reference", "standard", {**self.always, **self.reference}, ANOTHER_SEED)

    def _key(self, variant: Variant) -> str:
        return f"{variant.settings(self.stage).model_dump_json()} {variant.seed}"

    def _all(self) -> Iterator[Variant]:
        for preset in load_presets():
            if preset not in self.skip:
                yield Variant("preset", preset, preset, self.always)
        for setting, values in self.settings.items():
            for value in values:
                yield Variant("setting", _label({setting: value}), self.base, {**self.always, **self.beside, setting: value})
        for values in self.together:
            yield Variant("together", _label(values), self.base, {**self.always, **values})
        for seed in self.seeds:
            yield Variant("seed", f"seed {seed}", self.base, self.always, seed)


@cache
def studies() -> list[Study]:
    """Every study of `sweep.yaml`, in the order of the stages."""
    described: dict[str, dict[str, Any]] = yaml.safe_load((HERE / "sweep.yaml").read_text())
    return [Study(name=name, stage=name.split()[0], **entry) for name, entry in described.items()]


def _as_text(value: Any) -> str:
    return str(yaml.safe_dump(value, default_flow_style=True, width=1000)).removesuffix("\n").removesuffix("\n...")


def _label(values: Values) -> str:
    return " ".join(f"{setting}={_as_text(value)}" for setting, value in values.items())
