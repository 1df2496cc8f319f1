"""What a run modelled of a scene and what it left out, counted by the functions that decide it, for `run STAGE --explain`.

Every stage has an `explain` in its room. That of an object stage looks at a few objects of a shard, that of a set stage at the folder
it filled; what a kernel chooses, they count by calling what the kernel calls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.engine.stage import SetJob, Stage, Task
from pipeline.store.layout import Layout
from schemas.base import Artifact
from schemas.catalogue import ARTIFACTS


@dataclass(frozen=True)
class Part:
    """Things of one kind: how many were modelled, how many left out, and why these were.

    `shortcut` names what leaves them out in `benchmarks/tradeoff/shortcuts.py`, which measures what it saves and what it changes;
    empty where nothing could be modelled instead, because the settings, the method or the scene ask for no more.
    """

    what: str
    modelled: int
    left_out: int
    why: str
    shortcut: str = ""


ExplainObjects = Callable[[Any, Mapping[str, Path], Sequence[Task]], Iterable[Part]]
"""`explain` of an object stage: its settings, the models it reads, and objects, whose tasks hold the stage's own row too."""
ExplainSet = Callable[[SetJob], Iterable[Part]]
"""`explain` of a set stage; the job's folder is the one that it filled."""


def total(parts: Iterable[Part]) -> list[Part]:
    """Parts alike but for their counts added up, in the order of their first mention."""
    found: dict[tuple[str, str, str], Part] = {}
    for part in parts:
        key = part.what, part.why, part.shortcut
        before = found.get(key)
        found[key] = replace(part, modelled=part.modelled + before.modelled, left_out=part.left_out + before.left_out) if before else part
    return list(found.values())


def shards_opened(stage: Stage, settings: Any, data: Path) -> Part:
    """Which of the shards in a data directory, its own apart, a stage opens: those of its inputs."""
    inputs = {artifact.name for artifact in stage.inputs(settings)}
    own = {stage.output.name} if hasattr(stage, "output") else set()
    standing = {name: len(Layout(data).shards(name)) for name in ARTIFACTS if name not in own}
    closed = [name for name, count in standing.items() if count and name not in inputs]
    opened = sum(count for name, count in standing.items() if name in inputs)
    why = f"no input of this stage with these settings: {', '.join(closed)}" if closed else "all that stand here are inputs"
    return Part("shards opened", opened, sum(standing.values()) - opened, why)


def arrays_read(names: Iterable[str], artifacts: Iterable[Artifact]) -> Part:
    """Which arrays of the artifacts it opens a set stage reads."""
    declared = {name for artifact in artifacts for name in artifact.arrays} - {"object_id", "category", "split", "ok"}
    read = set(names)
    return Part("arrays read", len(read), len(declared - read), "nothing in this stage looks at them")
