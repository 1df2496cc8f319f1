"""Quote the measured error of a stage at given settings, for `run --explain`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pipeline.config.settings import Settings
from pipeline.tradeoff.measurements import Measurement, Study, load_studies
from pipeline.tradeoff.sweep import assignment


def quote(stage: str, settings: Settings) -> str:
    """Say what was measured of a stage's error at some settings, beside that of `standard`, and on which commit.

    Settings that were not measured together are quoted one by one where they differ from `standard`, with the nearest measured
    values where their own was not measured.

    Parameters
    ----------
    stage
        Its name.
    settings
        Its settings.

    Returns
    -------
    str
        One line; empty where nothing of the stage was measured.
    """
    of_stage = (study for study in load_studies().values() if study.stage == stage)
    studies = sorted(of_stage, key=lambda study: study.fixed_otherwise(settings))
    if not studies:
        return ""
    for study in studies:
        if found := study.at(settings):
            error = f"{study.metric}: {found.error:.3g}{_compared_with_standard(study, found)}"
            return f"measured at these settings{study.fixed_otherwise(settings)}: {error} [{study.source()}]"
    first, default = studies[0], type(settings)().accuracy()
    single = [_single(studies, name, value) for name, value in settings.accuracy().items() if value != default[name]]
    others = "".join(f" at {name}={value}" for name, value in first.varied_at.items()) + first.fixed_otherwise(settings)
    return f"not measured at these settings; one by one{others}, {first.metric}: {', '.join(single)} [{first.source()}]"


def _compared_with_standard(study: Study, found: Measurement) -> str:
    standard = next((one for one in study.measurements if one.is_preset("standard")), None)
    if standard is None or standard is found:
        return ""
    return f" (standard {standard.error:.3g}, {standard.seconds / found.seconds:.2g} × the time)"


def _single(studies: Iterable[Study], name: str, value: Any) -> str:
    """Quote the error where one setting alone has this value; else those at the nearest measured values below and above."""
    errors = {
        one.settings[name]: one.error
        for study in studies
        for one in study.measurements
        if one.kind == "setting" and one.label.startswith(f"{name}=")
    }
    if value in errors:
        return f"{assignment(name, value)}: {errors[value]:.3g}"
    measured = sorted(one for one in errors if _is_number(one)) if _is_number(value) else []
    near = [*[one for one in measured if one < value][-1:], *[one for one in measured if one > value][:1]]
    return f"{assignment(name, value)}: not measured" + (f" ({', '.join(f'{one}: {errors[one]:.3g}' for one in near)})" if near else "")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
