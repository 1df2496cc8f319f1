"""List what `make tradeoff` has not measured, or on older code: `python -m benchmarks.tradeoff.missing`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from benchmarks.tradeoff.figures import read_figures, section_rows
from benchmarks.tradeoff.study_plan import StudyPlan, study_plans
from benchmarks.tradeoff.training_choices import FAMILIES, choices_of
from pipeline.tradeoff.measurements import Study, load_studies
from stages.registry import STAGES, load_settings_type


def unmeasured(plans: Sequence[StudyPlan], studies: Mapping[str, Study]) -> Iterator[str]:
    """Name settings that no study varies, variants that were not measured, and studies of older code, one per line."""
    for stage in STAGES:
        settings = load_settings_type(stage)
        own = [plan for plan in plans if plan.stage == stage]
        varied = {name for plan in own for values in (plan.settings, *plan.combinations) for name in values}
        varied |= {setting.partition("=")[0] for choice in FAMILIES.get(stage, ((), {}))[1].values() for setting in choice}
        for name in settings.model_fields:
            if settings.changes(name) == "results" and name not in varied:
                yield f"{stage}.{name}: varied by no study"
    for plan in plans:
        study = studies.get(plan.name)
        if study is None:
            yield f"{plan.name}: not measured"
            continue
        for variant in plan.variants():
            wanted = variant.settings(plan.stage).accuracy()
            if not any(one.label == variant.label and one.settings == wanted for one in study.measurements):
                yield f"{plan.name}, {variant.label}: not measured at these settings"
        if not study.is_current():
            yield f"{plan.name}: measured at {study.source()}"


def unmeasured_choices(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Name the choices in training that were not measured, of the networks of which some were."""
    measured = {(row["network"], row["label"]) for row in rows}
    for network in sorted({network for network, _ in measured}):
        yield from (f"training, {network}, {name}: not measured" for name in choices_of(network) if (network, name) not in measured)


if __name__ == "__main__":
    choices = section_rows(read_figures(), "training")
    for line in (*unmeasured(study_plans(), load_studies()), *unmeasured_choices(choices)):
        print(line)
