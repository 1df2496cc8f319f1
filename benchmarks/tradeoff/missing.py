"""List what `make tradeoff` has not measured, or on older code: `python -m benchmarks.tradeoff.missing`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from benchmarks.tradeoff.study_plan import StudyPlan, study_plans
from pipeline.tuning.measurements import Study, load_studies
from stages.registry import STAGES, load_settings_type


def unmeasured(plans: Sequence[StudyPlan], studies: Mapping[str, Study]) -> Iterator[str]:
    """Name settings that no study varies, variants that were not measured, and studies of older code, one per line."""
    for stage in STAGES:
        settings = load_settings_type(stage)
        own = [plan for plan in plans if plan.stage == stage]
        varied = {name for plan in own for values in (plan.settings, *plan.combinations) for name in values}
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


if __name__ == "__main__":
    for line in unmeasured(study_plans(), load_studies()):
        print(line)
