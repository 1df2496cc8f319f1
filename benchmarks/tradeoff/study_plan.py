"""What is measured of each stage: `studies.yaml`, and from it one variant per setting."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import yaml

from pipeline.config.presets import load_presets
from pipeline.config.settings import Settings
from pipeline.tradeoff.sweep import assignment
from stages.registry import resolve

HERE = Path(__file__).parent
Kind = Literal["preset", "setting", "combination", "reference", "seed"]
REFERENCE_SEED = 1_000
"""Points of the reference are drawn otherwise: points drawn alike would agree better with each other than with the surface."""
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Variant:
    """A stage at one set of settings: a preset, and what is set on top of it."""

    kind: Kind
    label: str
    preset: str
    values: Values = field(default_factory=dict)
    seed: int | None = None

    def assignments(self, stage: str) -> list[str]:
        """Write the values as `--set` takes them."""
        return [f"{stage}.{assignment(name, value)}" for name, value in self.values.items()]

    def settings(self, stage: str) -> Settings:
        """Resolve all settings of the stage."""
        return resolve(stage, self.preset, self.assignments(stage))


@dataclass(frozen=True)
class StudyPlan:
    """The variants of a stage, as `studies.yaml` describes them.

    Attributes
    ----------
    name, stage
        A stage may have several studies: "train-gcn" and "train-gcn seeing".
    objects
        Name of the manifest, beside this file.
    base
        The preset from which single settings are varied.
    settings
        The values to try of each setting.
    combinations
        Several settings varied together.
    reference
        The most accurate settings, against which errors are measured; None where the error needs no reference.
    varied_at
        Further settings at which single settings are varied, so that their error shows.
    fixed
        Settings of every variant: which network is trained, for instance.
    skipped
        Presets that are not measured, with the reason.
    seeds
        Other seeds, at the base's settings: smaller differences are noise.
    costs
        Cost of a setting: "seconds", or "kilobytes" too.
    """

    name: str
    stage: str
    objects: str
    base: str
    settings: Mapping[str, list[Any]]
    combinations: list[Values] = field(default_factory=list)
    reference: Values | None = None
    varied_at: Values = field(default_factory=dict)
    fixed: Values = field(default_factory=dict)
    skipped: Mapping[str, str] = field(default_factory=dict)
    seeds: tuple[int, ...] = ()
    costs: tuple[str, ...] = ("seconds",)

    @property
    def manifest(self) -> Path:
        """The manifest's file."""
        return HERE / f"{self.objects}.yaml"

    def variants(self) -> list[Variant]:
        """List presets, single settings, combinations and seeds; equal settings are measured once."""
        found: dict[str, Variant] = {}
        for variant in self._all():
            key = f"{variant.settings(self.stage).model_dump_json()} {variant.seed}"
            same = found.setdefault(key, variant)
            if same is not variant and same.kind == variant.kind == "preset":
                found[key] = replace(same, label=f"{same.label}, {variant.label}")
        if len({one.label for one in found.values()}) < len(found):
            raise ValueError(f"{self.name}: two variants have one label, and would be made in one directory")
        return list(found.values())

    def reference_variant(self) -> Variant | None:
        """Build the variant that errors are measured against, if there is one."""
        if self.reference is None:
            return None
        return Variant("reference", "reference", "standard", {**self.fixed, **self.reference}, REFERENCE_SEED)

    def _all(self) -> Iterator[Variant]:
        for preset in load_presets():
            if preset not in self.skipped:
                yield Variant("preset", preset, preset, self.fixed)
        for name, values in self.settings.items():
            for value in values:
                yield Variant("setting", _label({name: value}), self.base, {**self.fixed, **self.varied_at, name: value})
        for combination in self.combinations:
            yield Variant("combination", _label(combination), self.base, {**self.fixed, **combination})
        for seed in self.seeds:
            yield Variant("seed", f"seed {seed}", self.base, self.fixed, seed)


@cache
def study_plans() -> list[StudyPlan]:
    """Load every study of `studies.yaml`, in the order of the stages."""
    described: dict[str, dict[str, Any]] = yaml.safe_load((HERE / "studies.yaml").read_text())
    return [StudyPlan(name=name, stage=name.split()[0], **entry) for name, entry in described.items()]


def _label(values: Values) -> str:
    return " ".join(assignment(name, value) for name, value in values.items())
