"""Test the supplement's claims as orderings of evaluations' figures, each with its interval over objects and trainings."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Row, Table
from pipeline.kernels.metrics.bootstrap import LEVEL, Interval, difference_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.models.families import FAMILIES, ROWS
from pipeline.rng import numpy_rng
from pipeline.tables.comparison import Trainings, chamfer_of, read_values
from pipeline.tables.supplement_figures import PAPER, TABLE_2, TABLE_3
from stages.evaluate.evaluation_files import Figures, read_root

MIN_OBJECTS = 6
"""Objects that a verdict needs: fewer agree by chance more than once in twenty, and give bootstrap intervals that are too short."""
PREFIXES = (
    "",
    *(f"{family}-" for family in FAMILIES if family),
    *sorted({f"{row.network}-" for name, row in ROWS.items() if name != row.network}),
)
"""Prefixes of configurations' names, by family: the claims are the same within each family."""

Answer = Literal["holds", "does not hold", "undecided"]


@dataclass(frozen=True)
class Verdict:
    """The test of a claim that one figure is smaller than another, in Table 3's unit, m² × 9000."""

    claim: str  # in words
    smaller: float  # mean over objects and trainings
    larger: float
    difference: Interval  # `smaller` - `larger`, object by object, and its interval over objects and trainings
    supplement: tuple[float, float] | None = None  # its two figures; None if it has none or for other sizes

    @property
    def answer(self) -> Answer:
        """Compare the interval with 0; few objects leave the claim undecided."""
        enough = self.difference.count >= MIN_OBJECTS
        if enough and self.difference.high < 0:
            return "holds"
        return "does not hold" if enough and self.difference.low > 0 else "undecided"


class Claim(NamedTuple):
    """Claim that the first of two sets of values has the smaller mean."""

    text: str
    smaller: NDArray[np.float64]  # (training, object) m²
    larger: NDArray[np.float64]  # (training, object) m²
    supplement: tuple[float, float] | None
    same_trainings: bool  # both are of the same ones


def orderings(folders: Sequence[Path]) -> list[Verdict]:
    """Test the claims that evaluations of the same objects, one per training seed, allow: one verdict each."""
    values, root = read_values(folders), read_root(folders[0])
    verdicts = []
    for claim in (*_modalities(values), *_grasps(values), *_rings(values)):
        if claim.smaller.size:
            smaller, larger = TABLE_3_FACTOR * claim.smaller, TABLE_3_FACTOR * claim.larger
            rng = numpy_rng(root["seed"], "orderings", claim.text)
            interval = difference_interval(smaller, larger, rng, same_trainings=claim.same_trainings)
            supplement = claim.supplement if root["paper_sizes"] else None
            verdicts.append(Verdict(claim.text, float(smaller.mean()), float(larger.mean()), interval, supplement))
    return verdicts


def _modalities(values: Trainings) -> Iterator[Claim]:
    """Claim that touch and vision together beat vision, vision beats touch, each beats nothing: with one grasp."""
    pairs = [
        pair for image in ("occluded", "unoccluded") for pair in ((f"{image}-touch", image), (image, "touch"), (f"{image}-touch", "touch"))
    ]
    pairs += [("touch", "none"), ("occluded", "none"), ("unoccluded", "none")]
    for smaller, larger in ((prefix + first, prefix + second) for prefix in PREFIXES for first, second in pairs):
        if {smaller, larger} <= values.keys():
            figures = _printed(TABLE_3, (smaller, 0), (larger, 0))
            nearer, further, same = _trainings(values, smaller, larger)
            yield Claim(f"{smaller} < {larger}", chamfer_of(nearer, 1), chamfer_of(further, 1), figures, same)


def _trainings(values: Trainings, first: str, second: str) -> tuple[list[Figures], list[Figures], bool]:
    """Choose the trainings of two configurations: if both are of one network, the common ones, compared one by one."""
    ours, theirs = values[first], values[second]
    seeds = [seed for seed in ours if seed in theirs] if ROWS[first].network == ROWS[second].network else []
    return [ours[seed] for seed in seeds or ours], [theirs[seed] for seed in seeds or theirs], bool(seeds)


def _grasps(values: Trainings) -> Iterator[Claim]:
    """Claim that more grasps are better: each against one fewer, and the most against one."""
    for name in (prefix + name for prefix in PREFIXES for name in ("touch", "occluded-touch", "unoccluded-touch")):
        trainings = [*values.get(name, {}).values()]
        counts = trainings[0].grasps if trainings else []
        for fewer, more in (*pairwise(counts), *([(counts[0], counts[-1])] if len(counts) > 2 else [])):
            figures = _printed(TABLE_3, (name, more - 1), (name, fewer - 1))
            yield Claim(f"{name}: {more} grasps < {fewer}", chamfer_of(trainings, more), chamfer_of(trainings, fewer), figures, True)


def _rings(values: Trainings) -> Iterator[Claim]:
    """Claim that with touch the error is least at the touch site, that without touch it is not, and that touch helps there."""
    last = max((max(next(iter(trainings.values())).rings, default=0) for trainings in values.values()), default=0) - 1
    for without_touch in (prefix + image for prefix in PREFIXES for image in ("occluded", "unoccluded")):
        with_touch = f"{without_touch}-touch"
        for (first, ring), (second, other_ring) in (
            ((with_touch, 0), (with_touch, last)),
            ((without_touch, last), (without_touch, 0)),
            ((with_touch, 0), (without_touch, 0)),
        ):
            if {first, second} <= values.keys() and (first, ring) != (second, other_ring):
                nearer, further, same = _trainings(values, first, second)
                in_both = (nearer[0].ring(ring + 1)[1] > 0) & (further[0].ring(other_ring + 1)[1] > 0)  # objects with points in both
                smaller = np.stack([figures.ring(ring + 1)[0][in_both] for figures in nearer])
                larger = np.stack([figures.ring(other_ring + 1)[0][in_both] for figures in further])
                text = f"{first}: ring ×{ring + 1} < ring ×{other_ring + 1}" if first == second else f"ring ×1: {first} < {second}"
                yield Claim(text, smaller, larger, _printed(TABLE_2, (first, ring), (second, other_ring), TABLE_3_FACTOR), same)


def _printed(
    table: Mapping[str, Sequence[float]], smaller: tuple[str, int], larger: tuple[str, int], factor: float = 1.0
) -> tuple[float, float] | None:
    """Look up two figures of a supplement's table, by configuration and column, in Table 3's unit; None where it does not print both."""
    printed = [factor * table[name][column] for name, column in (smaller, larger) if column < len(table.get(name, ()))]
    return (printed[0], printed[1]) if len(printed) == 2 else None


def orderings_table(verdicts: Sequence[Verdict]) -> list[Table]:
    """Make one row per verdict, and count the answers below; orderings that do not hold in the supplement either are marked."""
    if not verdicts:
        return []
    paper = any(verdict.supplement is not None for verdict in verdicts)
    columns = ["claim", "here", f"difference ({100 * LEVEL:.0f} %)", "objects", "verdict", *([PAPER] if paper else [])]
    title = f"Do the orderings of {PAPER} hold? Chamfer distances × {TABLE_3_FACTOR:.0f}, m²; intervals over objects (paired) and trainings"
    rows = []
    for verdict in verdicts:
        difference, theirs = verdict.difference, None
        if verdict.supplement is not None:
            smaller, larger = verdict.supplement
            theirs = f"{smaller:.3f} vs {larger:.3f}" + (" (not there either)" if smaller >= larger else "")
        ours = f"{verdict.smaller:.3f} vs {verdict.larger:.3f}"
        rows.append(Row([verdict.claim, ours, difference.signed(".3f"), difference.count, verdict.answer, *([theirs] if paper else [])]))
    counts = Counter(verdict.answer for verdict in verdicts)
    answers = ", ".join(f"{counts[answer]} {answer}" for answer in get_args(Answer))
    return [Table(title, columns, rows), Table(f"{answers} of {len(verdicts)} (fewer than {MIN_OBJECTS} objects decide nothing)")]
