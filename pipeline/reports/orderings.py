"""The supplement's claims as orderings of an evaluation's figures, each with its interval over objects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from pipeline.kernels.metrics.bootstrap import LEVEL, Interval, difference_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.rng import numpy_rng
from stages.evaluate.store import Arrays, read_root, read_table
from stages.evaluate.supplement import TABLE_2, TABLE_3
from stages.evaluate.tables import per_object, ring_per_object

FEWEST = 6
"""Objects a verdict needs: of fewer, all agree by chance more than once in twenty, and their bootstrap intervals are far too short."""

Answer = Literal["holds", "does not hold", "undecided"]
Values = dict[str, Arrays]
Pair = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True)
class Verdict:
    """Whether one figure is smaller than another, as is claimed.

    Attributes
    ----------
    claim
        In words.
    smaller, larger
        The two means over objects, in that order as claimed; m² times 9000, Table 3's unit.
    difference
        `smaller` - `larger`, object by object, and its interval.
    supplement
        The same two figures in the supplement, None where it prints none.
    """

    claim: str
    smaller: float
    larger: float
    difference: Interval
    supplement: tuple[float, float] | None = None

    @property
    def answer(self) -> Answer:
        """Whether the whole interval is on the claimed side of 0, on the other, or on both; of few objects, undecided."""
        if self.difference.count < FEWEST:
            return "undecided"
        if self.difference.high < 0:
            return "holds"
        return "does not hold" if self.difference.low > 0 else "undecided"


@dataclass(frozen=True)
class Claim:
    """A claim that the first of two rows of values, one an object, has the smaller mean."""

    text: str
    pair: Pair
    supplement: tuple[float, float] | None = None


def orderings(folder: Path) -> list[Verdict]:
    """Test the claims that the models of an evaluation folder allow, one verdict each; the same for the same evaluation.

    Raises
    ------
    StoreError
        There is no finished evaluation in the folder.
    """
    root = read_root(folder)
    values = {name: read_table(folder, f"values/{name}") for name in root["configurations"]}
    claims = [*_modalities(values), *_grasps(values), *_rings(values)]
    return [_verdict(claim, numpy_rng(root["seed"], "orderings", claim.text)) for claim in claims if len(claim.pair[0])]


def _verdict(claim: Claim, rng: np.random.Generator) -> Verdict:
    smaller, larger = (TABLE_3_FACTOR * values for values in claim.pair)
    difference = difference_interval(smaller, larger, rng)
    return Verdict(claim.text, float(smaller.mean()), float(larger.mean()), difference, claim.supplement)


def _modalities(values: Values) -> Iterator[Claim]:
    """Touch and vision together beat vision, vision beats touch, both and each beat nothing: with one grasp."""
    for image in ("occluded", "unoccluded"):
        for smaller, larger in ((f"{image}-touch", image), (image, "touch"), (f"{image}-touch", "touch")):
            if {smaller, larger} <= values.keys():
                theirs = (TABLE_3[smaller][0], TABLE_3[larger][0]) if {smaller, larger} <= TABLE_3.keys() else None
                yield Claim(f"{smaller} < {larger}", (per_object(values[smaller], 1), per_object(values[larger], 1)), theirs)
    for name in ("touch", "occluded", "unoccluded"):
        if {name, "none"} <= values.keys():
            yield Claim(f"{name} < none", (per_object(values[name], 1), per_object(values["none"], 1)))


def _grasps(values: Values) -> Iterator[Claim]:
    """More grasps are better: each against one fewer, and the most against one."""
    for name in ("touch", "occluded-touch", "unoccluded-touch"):
        given = [int(number) for number in values[name]["grasps_given"]] if name in values else []
        steps = [*zip(given[1:], given[:-1], strict=True)]
        if len(given) > 2:
            steps.append((given[-1], given[0]))
        for more, fewer in steps:
            theirs = TABLE_3.get(name, ())
            figures = (theirs[more - 1], theirs[fewer - 1]) if more <= len(theirs) else None
            yield Claim(f"{name}: {more} grasps < {fewer}", (per_object(values[name], more), per_object(values[name], fewer)), figures)


def _rings(values: Values) -> Iterator[Claim]:
    """With touch the error is least at the touch site, without it is not; and touch helps there more than further off."""
    for image in ("occluded", "unoccluded"):
        for name, inner_is_smaller in ((f"{image}-touch", True), (image, False)):
            last = values[name]["local_chamfer"].shape[-1] - 1 if name in values else 0
            if not last:
                continue
            first, outer = (ring_per_object(values[name], ring) for ring in (0, last))
            both = (first[1] > 0) & (outer[1] > 0)
            theirs = (TABLE_2[name][0], TABLE_2[name][last]) if last < len(TABLE_2[name]) else None
            pair = (first[0][both], outer[0][both])
            text = f"{name}: ring ×1 < ring ×{last + 1}" if inner_is_smaller else f"{name}: ring ×{last + 1} < ring ×1"
            yield Claim(text, pair if inner_is_smaller else pair[::-1], _scaled(theirs, inner_is_smaller))
        if {image, f"{image}-touch"} <= values.keys():
            felt, seen = (ring_per_object(values[name], 0) for name in (f"{image}-touch", image))
            some = felt[1] > 0
            theirs = (TABLE_2[f"{image}-touch"][0], TABLE_2[image][0])
            yield Claim(f"ring ×1: {image}-touch < {image}", (felt[0][some], seen[0][some]), _scaled(theirs, True))


def _scaled(figures: tuple[float, float] | None, in_order: bool) -> tuple[float, float] | None:
    """Table 2's figures in Table 3's unit, in the order claimed."""
    if figures is None:
        return None
    first, second = (TABLE_3_FACTOR * figure for figure in figures)
    return (first, second) if in_order else (second, first)


def show_orderings(verdicts: list[Verdict], console: Console) -> None:
    """Print the verdicts, a row each; an ordering that the supplement itself does not have is marked."""
    columns = ("claim", "here", f"difference ({100 * LEVEL:.0f} %)", "objects", "verdict", "supplement")
    title = f"Do the supplement's orderings hold? Chamfer distances × {TABLE_3_FACTOR:.0f}; intervals over objects, paired"
    printed = Table(*columns, title=title, title_justify="left", title_style="bold", box=None, padding=(0, 2))
    style = {"holds": "green", "does not hold": "red", "undecided": "yellow"}
    for one in verdicts:
        between = one.difference
        known = np.isfinite([between.low, between.high]).all()
        ends = f" ({between.low:+.3f} to {between.high:+.3f})" if known else ""
        theirs = "–" if one.supplement is None else "{:.3f} vs {:.3f}".format(*one.supplement)
        note = " (not there either)" if one.supplement is not None and one.supplement[0] >= one.supplement[1] else ""
        answer = f"[{style[one.answer]}]{one.answer}[/]"
        cells = (f"{one.smaller:.3f} vs {one.larger:.3f}", f"{between.mean:+.3f}{ends}", str(between.count), answer, theirs + note)
        printed.add_row(one.claim, *cells)
    console.print(printed)
    counts = {answer: sum(one.answer == answer for one in verdicts) for answer in style}
    console.print(
        ", ".join(f"{count} {answer}" for answer, count in counts.items())
        + f" of {len(verdicts)} (fewer than {FEWEST} objects decide nothing)"
    )
