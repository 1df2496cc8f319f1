"""Which reconstructions an evaluation needs: each once, however many figures it gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """Choose grasps, the same for every object.

    Attributes
    ----------
    first
        The first grasp; the occluded image is the one with the hand in it.
    grasps
        The grasps whose touches are given, none for a model without touch.
    given
        Place in the numbers of grasps evaluated.
    firsts
        The first grasps whose figures the reconstruction gives.
    """

    first: int
    grasps: tuple[int, ...]
    given: int
    firsts: tuple[int, ...]


def make_cases(available: int, numbers: Sequence[int], *, touch: bool, occluded: bool) -> list[Case]:
    """List the cases of a model that takes `touch` or not and the `occluded` image or not, of `available` grasps per object.

    A model without touch is the same for any number of grasps, without the occluded image for any grasp; all grasps are
    the same grasps whichever comes first.
    """
    every = tuple(range(available))
    if not touch:
        return [Case(first, (), 0, (first,)) for first in every] if occluded else [Case(0, (), 0, every)]
    cases = []
    for given, number in enumerate(numbers):
        if number == available and not occluded:
            cases.append(Case(0, every, given, every))
            continue
        for first in every:
            cases.append(Case(first, tuple((first + step) % available for step in range(number)), given, (first,)))
    return cases
