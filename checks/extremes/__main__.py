"""Feeds every kernel with every extreme: `python -m checks.extremes`, and writes the largest errors as a page with `--write`."""

import sys
import warnings
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.provenance import provenance
from checks.extremes.kernels import KERNELS
from checks.extremes.outcome import Outcome, feed
from checks.extremes.shapes import SHAPES

INTRODUCTION = """\
# Extremes

Each kernel that takes geometry is fed with the extremes of its range, and with shapes beyond it. A cell is the largest error against
rational or 80-bit arithmetic. *Refused* means an error in words. The first table holds the shapes that kernels must take; the second holds
those that they may refuse, but must not get wrong. Shapes are icospheres of 80 faces where nothing else is said, 0.1 m large where they lie
away from the origin or are cut. Where a kernel's docstring promises less for a shape, that follows the error in brackets.

- Errors are shares of what the column "error in" names: the largest coordinate, the product of two edges, the area, the spacing of the
  grid, or the width of the sensor. m, pixels and levels (of 255) are units; 1 is none.
- slivers 1e8: a ball with a triangle along an edge of each face, about 1e8 times as long as high; one sliver: such a triangle alone.
- grazing 1e-8: walls, which the rays of a sensor meet at an angle of 1e-8 rad.
- coincident: no two faces share a vertex, one is there three times, once inside out, and two have shrunk to a segment and a point.
- float32: a ball whose vertices were rounded to single precision; denormal: a ball of 1e-310 m.
"""


def main(write: Annotated[Path | None, typer.Option(help="page to write")] = None) -> None:
    """Feed all, print the tables, and end with status 1 where a kernel is wrong."""
    warnings.simplefilter("ignore")
    outcomes: dict[tuple[str, str], Outcome] = {}
    for kernel in KERNELS:
        print(kernel.name, file=sys.stderr)
        outcomes |= {(kernel.name, shape.name): feed(kernel, shape) for shape in SHAPES}
    about = provenance("make test-extremes", "python -m checks.extremes")
    page = [INTRODUCTION, f"`{about['command']}`, commit {about['commit']}, {about['date']}, {about['machine']}:\n"]
    for shapes in ([s for s in SHAPES if not s.beyond], [s for s in SHAPES if s.beyond]):
        page += [
            "| kernel | error in | promised | " + " | ".join(shape.name for shape in shapes) + " |",
            "| --- " * (3 + len(shapes)) + "|",
        ]
        for kernel in KERNELS:
            cells = [outcomes[kernel.name, shape.name].text for shape in shapes]
            page.append(f"| {kernel.name} | {kernel.unit} | {kernel.bound:.0e} | " + " | ".join(cells) + " |")
        page.append("")
    text = "\n".join(page)
    print(text)
    if write is not None:
        write.write_text(text)
    wrong = [f"{name}, {shape}: {outcome.wrong}" for (name, shape), outcome in outcomes.items() if outcome.wrong]
    print("\n".join(wrong), file=sys.stderr)
    raise SystemExit(bool(wrong))


if __name__ == "__main__":
    typer.run(main)
