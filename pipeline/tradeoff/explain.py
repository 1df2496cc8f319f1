"""Count what a run modelled and what it left out, for `run STAGE --explain`.

Each stage's counts are in `pipeline.tradeoff.explanations`. Those of an object stage are taken on a few objects of a shard, those
of a dataset stage on the folder that it filled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from pipeline.console import console
from pipeline.engine.plan import Plan
from pipeline.engine.session import verified_inputs
from pipeline.engine.shard import read_row
from pipeline.engine.stage import DatasetJob, Stage
from pipeline.engine.unit import Unit
from pipeline.store.publish import FolderOutput, ShardOutput
from schemas.base import COMMON, COORDINATES, Artifact

OBJECTS = 4
"""Objects of a shard that are counted, spread evenly: about a second each."""


@dataclass(frozen=True)
class Count:
    """Things of one kind: how many were modelled, how many left out, and why these were.

    `shortcut` is the name, in `benchmarks/tradeoff/shortcuts.py`, of what saves the work; empty where settings, method or scene
    ask for no more.
    """

    what: str
    modelled: int
    left_out: int
    why: str
    shortcut: str = ""


@dataclass(frozen=True)
class Explanation:
    """What a run modelled and left out, with a title that says on which objects it was counted."""

    title: str
    counts: Sequence[Count]

    def table(self) -> Table:
        """Lay out the counts for a console."""
        table = Table(box=None, padding=(0, 2, 0, 0))
        for name in ("", "modelled", "left out", "%", "why it was left out", "shortcut"):
            table.add_column(name, justify="right" if name in ("modelled", "left out", "%") else "left")
        for count in self.counts:
            total = count.modelled + count.left_out
            share = f"{100 * count.left_out / total:.0f}" if total else "–"
            why = escape(count.why) if count.left_out else ""
            table.add_row(escape(count.what), f"{count.modelled:,}", f"{count.left_out:,}", share, why, count.shortcut)
        return table


def explain_plan(plan: Plan[Any]) -> Explanation | None:
    """Explain what is up to date: a shard on a few of its objects (on `only`, if one was asked for), or a folder.

    Parameters
    ----------
    plan
        Of the run.

    Returns
    -------
    Explanation or None
        None where no object of the shard was processed.
    """
    request, stage, count = plan.request, plan.stage, _counts_of(plan.stage)
    if isinstance(plan.output, FolderOutput):
        folder = plan.directory.whole_folder(plan.units[0].name)
        counts = count(DatasetJob(request.data, folder, request.settings, request.seed, plan.models, console))
        return Explanation(f"{stage.name} {folder}: counted on its objects", total(counts))
    if not (units := processed_units(plan)):
        return None
    few = f"{len(units)} of {plan.total} objects ({', '.join(unit.name for unit, _ in units)})"
    return Explanation(f"{stage.name} {plan.path}: counted on {few}", total(count(plan.settings, plan.models, units)))


def total(counts: Iterable[Count]) -> list[Count]:
    """Add up counts of the same things, left out for the same reason, in the order of their first mention."""
    found: dict[tuple[str, str, str], Count] = {}
    for count in counts:
        key = count.what, count.why, count.shortcut
        before = found.get(key, replace(count, modelled=0, left_out=0))
        found[key] = replace(count, modelled=count.modelled + before.modelled, left_out=count.left_out + before.left_out)
    return list(found.values())


def arrays_read(names: Iterable[str], artifacts: Iterable[Artifact]) -> Count:
    """Count the arrays of its input artifacts that a dataset stage reads."""
    declared = {name for artifact in artifacts for name in artifact.arrays} - {*COMMON, *COORDINATES}
    read = set(names)
    return Count("arrays read", len(read), len(declared - read), "not used by this stage")


def processed_units(plan: Plan[ShardOutput]) -> list[tuple[Unit, dict[str, Any]]]:
    """Read the inputs of a few of a shard's processed objects, with the stage's own row among them."""
    asked = (unit for unit in plan.units if plan.request.only in (None, unit.name))
    rows = [(unit, row) for unit in asked if (row := read_row(plan, unit)) is not None]
    chosen = (rows[number] for number in np.linspace(0, len(rows) - 1, min(OBJECTS, len(rows))).astype(int))
    return [(unit, {**verified_inputs(unit, plan.inputs), plan.output.artifact.name: row}) for unit, row in chosen]


def _counts_of(stage: Stage) -> Any:
    """Find the stage's function in `pipeline.tradeoff.explanations`.

    Of an object stage: (settings, models by name: Mapping[str, Path], units with their inputs) -> Iterable[Count]; of a dataset stage:
    (job) -> Iterable[Count]. One that counts nothing for a stage without a module there.
    """
    name = f"pipeline.tradeoff.explanations.{stage.name.replace('-', '_')}"
    return import_module(name).explain if find_spec(name) else lambda *_: ()
