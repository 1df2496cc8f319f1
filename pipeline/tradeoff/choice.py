"""Choose settings for a time or an error, among measured ones (`pipeline.tradeoff.measurements`)."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pipeline.errors import InvalidInput
from pipeline.tradeoff.measurements import Measurement, Study
from pipeline.tradeoff.sweep import assignment
from stages.registry import load_settings_type

PRESET = "standard"
"""Advice is given as changes to this preset, the defaults."""
_NUMBER = r"([0-9]+\.?[0-9]*|\.[0-9]+)"
_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}


@dataclass(frozen=True)
class MachineSpeed:
    """How fast this machine runs a stage.

    Attributes
    ----------
    factor
        Its seconds per measured second.
    startup
        Seconds of one run apart from its objects.
    publishing
        Seconds per kilobyte of output that workers do not share: one process publishes all rows.
    """

    factor: float = 1.0
    startup: float = 0.0
    publishing: float = 0.0


@dataclass(frozen=True)
class Choice:
    """A measured setting for a stage, and the seconds that it takes for all objects here."""

    study: Study
    measurement: Measurement
    seconds: float

    @property
    def log_bound(self) -> float:
        """Logarithm of the error's bound; for a bound of zero (the reference's) that of the smallest above zero."""
        positive = (one.bound for one in self.study.measurements if one.bound > 0)
        return math.log(self.measurement.bound or min(positive, default=1.0))

    def assignments(self) -> list[str]:
        """Write as `--set` takes them the settings that differ from those of `PRESET`."""
        preset = load_settings_type(self.study.stage)().accuracy()
        changed = {name: value for name, value in self.measurement.settings.items() if preset[name] != value}
        return [f"{self.study.stage}.{assignment(name, value)}" for name, value in changed.items()]


@dataclass(frozen=True)
class Workload:
    """What is to be made, and how fast this machine is.

    Attributes
    ----------
    objects
        Number of objects that each stage processes, by stage.
    workers
        Processes that share them, where they are processed one by one.
    speeds
        By stage, once the stages were tried on this machine; before that each is as fast as measured.
    """

    objects: Mapping[str, int]
    workers: int
    speeds: Mapping[str, MachineSpeed] = field(default_factory=dict)

    def choice(self, study: Study, measurement: Measurement) -> Choice:
        """Predict the time of a measured setting here."""
        speed, objects = self.speeds.get(study.stage, MachineSpeed()), self.objects[study.stage]
        share = objects / study.objects if study.whole_dataset else math.ceil(objects / self.workers)
        publishing = 0.0 if study.whole_dataset else objects * measurement.kilobytes * speed.publishing
        return Choice(study, measurement, speed.startup + share * measurement.seconds * speed.factor + publishing)


@dataclass(frozen=True)
class Limit:
    """An upper limit on an error: of one stage, or of the only stage whose error has this unit."""

    value: float
    unit: str
    stage: str | None = None


def duration(text: str) -> float:
    """Parse a duration.

    Parameters
    ----------
    text
        Such as "90s", "10min" or "1.5h".

    Returns
    -------
    float
        Seconds.

    Raises
    ------
    InvalidInput
        The text is something else.
    """
    match = re.fullmatch(rf"{_NUMBER} *(s|min|h)", text.strip())
    if not match or not (value := float(match[1])):
        raise InvalidInput(f"{text!r} is not a time; write 90s, 10min or 1.5h")
    return value * _UNITS[match[2]]


def error_limit(text: str) -> Limit:
    """Parse a limit on an error.

    Parameters
    ----------
    text
        Such as "5um", "2%" or "fit-charts=200um".

    Returns
    -------
    Limit
        With "µm" written as "um".

    Raises
    ------
    InvalidInput
        The text is something else.
    """
    match = re.fullmatch(rf"(?:([a-z-]+) *= *)?({_NUMBER}(?:[eE][-+]?[0-9]+)?) *([^0-9. ].*)?", text.strip())
    if not match or not (match[1] or match[4]):
        raise InvalidInput(f"{text!r} is not an error; write a number and the unit it is measured in, as 5um, 2% or fit-charts=200um")
    return Limit(float(match[2]), (match[4] or "").replace("µm", "um"), match[1])


def within_time(studies: Sequence[Study], workload: Workload, seconds: float) -> list[Choice]:
    """Choose one setting per stage, all together within a time, such that the product of their error bounds is least.

    Bounds have different units, so they are compared by ratios: halving one counts as much as halving another.

    Parameters
    ----------
    studies
        One per stage.
    workload
        What is to be made, and how fast this machine is.
    seconds
        For all stages together.

    Returns
    -------
    list of Choice
        In the order of `studies`. The fastest, where even these take longer and were not tried on this machine, which may be faster
        than the one that measured.

    Raises
    ------
    InvalidInput
        Even the fastest settings take longer, as tried on this machine; the message says how long.
    """
    plans: list[tuple[float, float, tuple[Choice, ...]]] = [(0.0, 0.0, ())]  # seconds, logarithm of the product of bounds, choices
    for study in studies:
        options = [workload.choice(study, one) for one in study.front()]
        longer = [(t + one.seconds, e + one.log_bound, (*chosen, one)) for (t, e, chosen), one in itertools.product(plans, options)]
        plans = []
        for plan in sorted(longer, key=lambda plan: plan[:2]):
            if not plans or plan[1] < plans[-1][1]:  # no other is both faster and more accurate
                plans.append(plan)
    fitting = [plan for plan in plans if plan[0] <= seconds]
    if not fitting and workload.speeds:
        raise InvalidInput(f"the fastest measured settings take {plans[0][0]:.0f} s, {seconds:.0f} s were given; take fewer objects")
    return list((fitting or plans[:1])[-1][2])  # the slowest of them is the most accurate


def within_error(studies: Sequence[Study], workload: Workload, limit: Limit) -> list[Choice]:
    """Choose the fastest setting whose bound is within the limit, and `PRESET` for the stages that it does not limit.

    Parameters
    ----------
    studies
        One per stage.
    workload
        What is to be made, and how fast this machine is.
    limit
        Applies to exactly one of the studies.

    Returns
    -------
    list of Choice
        In the order of `studies`.

    Raises
    ------
    InvalidInput
        The limit applies to no stage or to several, or no setting is accurate enough; the message says what there is.
    """
    limited = _limited(studies, limit)
    fits = [one for one in limited.choices if one.bound <= limit.value]
    if not fits:
        best = min(one.bound for one in limited.choices)
        raise InvalidInput(f"{limited.name}: {limited.metric}, stays below {best:.3g} at best, 19 times in 20, not {limit.value:g}")
    chosen = []
    for study in studies:
        candidates = fits if study is limited else [one for one in study.measurements if one.is_preset(PRESET)]
        options = [workload.choice(study, one) for one in candidates]
        chosen.append(min(options, key=lambda one: (round(one.seconds, 1), one.measurement.kilobytes, one.measurement.bound)))
    return chosen


def _limited(studies: Sequence[Study], limit: Limit) -> Study:
    """Find the one study that a limit applies to."""
    found = [study for study in studies if (study.unit == limit.unit if limit.stage is None else study.stage == limit.stage)]
    if len(found) != 1:
        measured = ", ".join(f"{study.stage} in {_unit(study)}" for study in studies)
        if limit.stage is not None:
            raise InvalidInput(f"settings are not chosen for {limit.stage} here, but for {measured}")
        raise InvalidInput(f"{'several stages are' if found else 'no stage is'} measured so; say which, as STAGE=5um: {measured}")
    if limit.unit != found[0].unit:
        raise InvalidInput(f"{found[0].stage} is measured in {_unit(found[0])}: {found[0].metric}")
    return found[0]


def _unit(study: Study) -> str:
    return study.unit or "a number without unit"
