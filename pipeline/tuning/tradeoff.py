"""What settings cost and how wrong they are, as measured by `make tradeoff`: read by whoever has to choose."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

from pipeline.config.settings import Settings

ASSET = "tradeoff.json"
SLACK = {"seconds": 0.2, "kilobytes": 0.02, "error": 0.02}
"""Shares by which two settings must differ for one to count as better: times are noisy, the others nearly not."""
NEAR = {"seconds": 0.25, "kilobytes": 0.25, "error": 0.25}
"""Shares by which another setting must be better for one not to lie near the front."""


@dataclass(frozen=True)
class Point:
    """A setting as measured.

    Attributes
    ----------
    kind
        "preset", "setting" (one varied), "together" (several) or "seed" (nothing varied).
    settings
        All settings that change results, without those that define what is asked for.
    seconds, kilobytes
        On one core: of an object, or of the whole where the stage looks at all objects at once.
    figures
        By name with unit; the first is the error.
    bound
        What the error of another data set like those that were measured stays below, 19 times in 20.
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
        """Whether it is the preset of that name as a whole; presets of the same settings share a point."""
        return self.kind == "preset" and name in self.label.split(", ")

    def dominates(self, other: Point, costs: Iterable[str], by: Mapping[str, float] = SLACK) -> bool:
        """Whether it is no worse than another in cost and error, slack apart, and better in one of them by more than these shares."""
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in (*costs, "error")}
        no_worse = all(ours <= theirs * (1 + SLACK[name]) for name, (ours, theirs) in pairs.items())
        return no_worse and any(ours < theirs * (1 - by[name]) for name, (ours, theirs) in pairs.items())


@dataclass(frozen=True)
class Trade:
    """The settings of a stage that were measured, on the same objects in one run.

    Attributes
    ----------
    name, stage
        A stage may have several: "train-gcn" and "train-gcn seeing".
    objects
        How many it was measured on; of a training, how many it learned from.
    whole
        Whether the stage looks at all objects at once, so that seconds are those of all of them.
    costs
        What counts beside the error: "seconds", or "kilobytes" too.
    always
        What all points set that defines what is asked for: which network is trained, for instance.
    beside
        What stood beside single settings, other than in `standard`.
    skipped
        Presets that were not measured as wholes, and why.
    """

    name: str
    stage: str
    objects: int
    whole: bool
    costs: tuple[str, ...]
    points: tuple[Point, ...]
    skipped: Mapping[str, str]
    always: Mapping[str, Any] = field(default_factory=dict)
    beside: Mapping[str, Any] = field(default_factory=dict)

    @property
    def metric(self) -> str:
        """What the error is, with its unit."""
        return next(iter(self.points[0].figures))

    @property
    def unit(self) -> str:
        """The unit of the error; the empty string for a number without one."""
        return self.metric.rpartition(", ")[2] if ", " in self.metric else ""

    @property
    def choices(self) -> list[Point]:
        """The points that one can choose among: other seeds are none."""
        return [point for point in self.points if point.kind != "seed"]

    def front(self) -> list[Point]:
        """The settings that no other dominates, the cheapest first."""
        return sorted((one for one in self.choices if self._is_best(one, SLACK)), key=lambda point: point.seconds)

    def is_near_front(self, preset: str) -> bool:
        """Whether no setting is a lot better than a preset."""
        return all(self._is_best(point, NEAR) for point in self.points if point.is_preset(preset))

    def _is_best(self, point: Point, by: Mapping[str, float]) -> bool:
        return not any(other.dominates(point, self.costs, by) for other in self.choices)

    def apart(self, settings: Settings) -> str:
        """What was asked for when it was measured, where the settings ask for something else; else the empty string."""
        asked = settings.model_dump(mode="json")
        return "".join(f", with {setting}={value}" for setting, value in self.always.items() if asked[setting] != value)

    def at(self, settings: Settings) -> Point | None:
        """The measurement at these settings, if there is one; settings that define what is asked for may be others."""
        wanted = settings.accuracy()
        return next((point for point in self.choices if point.settings == wanted), None)


def in_words(stage: str, settings: Settings) -> str:
    """What is known of the error of a stage at some settings, beside `standard`'s; the empty string where nothing was measured.

    Of settings that were not measured together every setting that differs from `standard` is told alone, with its nearest measured
    values where its own was not measured.
    """
    trades = sorted((trade for trade in load_trades().values() if trade.stage == stage), key=lambda trade: trade.apart(settings))
    if not trades:
        return ""
    for trade in trades:
        if point := trade.at(settings):
            return f"measured at these settings{trade.apart(settings)}: {trade.metric}: {point.error:.3g}{_beside(trade, point)}"
    default = type(settings)().accuracy()
    known = [_alone(trades, setting, value) for setting, value in settings.accuracy().items() if value != default[setting]]
    others = "".join(f" at {setting}={value}" for setting, value in trades[0].beside.items()) + trades[0].apart(settings)
    return f"not measured at these settings; one by one{others}, {trades[0].metric}: {', '.join(known)}"


def assigned(setting: str, value: Any) -> str:
    """The setting and its value, as `--set` takes them."""
    return f"{setting}={'null' if value is None else str(value).lower()}"


def _beside(trade: Trade, point: Point) -> str:
    standard = next((one for one in trade.points if one.is_preset("standard")), None)
    if standard is None or standard is point:
        return ""
    return f" (standard {standard.error:.3g}, {standard.seconds / point.seconds:.2g} × the time)"


def _alone(trades: Iterable[Trade], setting: str, value: Any) -> str:
    """The error where a single setting has a value; else those at the nearest values below and above that were measured."""
    points = [point for trade in trades for point in trade.points if point.kind == "setting" and point.label.startswith(f"{setting}=")]
    for point in points:
        if point.settings[setting] == value:
            return f"{assigned(setting, value)}: {point.error:.3g}"
    errors = {one: point.error for point in points if _is_number(one := point.settings[setting])}
    tried = sorted(errors) if _is_number(value) else []
    near = [*[one for one in tried if one < value][-1:], *[one for one in tried if one > value][:1]]
    return f"{assigned(setting, value)}: not measured" + (f" ({', '.join(f'{one}: {errors[one]:.3g}' for one in near)})" if near else "")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


@cache
def load_trades() -> dict[str, Trade]:
    """Every trade by name, in the order of the stages; none where `make tradeoff` has not been run."""
    asset = resources.files("pipeline.tuning").joinpath(ASSET)
    if not asset.is_file():
        return {}
    return {name: _trade(name, entry) for name, entry in json.loads(asset.read_text())["trades"].items()}


def _trade(name: str, entry: Mapping[str, Any]) -> Trade:
    points = tuple(Point(**point) for point in entry["points"])
    return Trade(**{**entry, "name": name, "costs": tuple(entry["costs"]), "points": points})
