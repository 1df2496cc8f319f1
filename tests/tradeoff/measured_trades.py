"""Trades as if they were measured."""

from collections.abc import Sequence

from pipeline.tradeoff.trades import MeasuredTrade, Point


def point(label: str, seconds: float, errors: Sequence[float], **changes: object) -> Point:
    """Make a point whose objects all take the same time."""
    named = {f"object-{number}": error for number, error in enumerate(errors)}
    return Point(
        label=label,
        changes=changes,
        times=dict.fromkeys(named, seconds),
        kilobytes=10,
        errors={name: (one,) for name, one in named.items()},
    )


def trade(stage: str, unit: str, *points: Point, preset: str = "draft", trained: int = 0, trials: int = 0) -> MeasuredTrade:
    """Make a trade of four objects."""
    return MeasuredTrade(
        stage=stage,
        metric="how wrong it is",
        unit=unit,
        key="key",
        preset=preset,
        assignments=(),
        objects=tuple(f"object-{number}" for number in range(4)),
        sample="sample",
        trained=trained,
        trials=trials,
        machine="a machine",
        total=len(points),
        points=points,
    )
