"""What is measured, and from which inputs: trained networks, or the files of another method."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from pipeline.dataset.object_rows import ObjectRows
from pipeline.models import reconstruction
from pipeline.models.observation import Observation, stored_observation
from pipeline.models.reconstruction import Reconstruction


@dataclass(frozen=True)
class Case:
    """Choose grasps, or a view, the same for every object."""

    first: int  # the first grasp, with whose hand the occluded image is; or the view
    grasps: tuple[int, ...]  # whose touches are given, none for a network without touch
    grasp_count: int  # under which the figures are reported
    firsts: tuple[int, ...]  # the first grasps whose figures the reconstruction gives


class Reconstructor(Protocol):
    """Reconstructs test objects in the cases that it has."""

    name: str  # of its row in the tables
    touch: bool  # whether it, or baselines beside it, take touches
    charts: bool  # whether it takes touches as touch charts
    has_charts: bool  # whether its surfaces are deformed charts
    keeps_surfaces: bool  # whether the evaluation keeps them

    @property
    def image(self) -> str | None:
        """The kind of image that it, or baselines beside it, take."""

    @property
    def inputs(self) -> Mapping[str, Any]:
        """Describe its inputs, for tables."""

    def cases(self, available: int, numbers: Sequence[int]) -> list[Case]:
        """List the cases of objects with `available` grasps each, for the requested numbers of grasps."""

    def reconstruct(self, objects: ObjectRows, work: Sequence[tuple[str, Case]]) -> list[Reconstruction]:
        """Reconstruct objects, by id, in cases."""

    def remarks(self) -> Iterable[str]:
        """Report on what was measured."""


class Network:
    """A trained network."""

    def __init__(
        self,
        name: str,
        model: reconstruction.Reconstructor,
        *,
        first_only: bool = False,  # only cases that begin with the first grasp: a fifth of the time of five grasps
        keeps_surfaces: bool = True,
    ) -> None:
        self.name, self.model, self.first_only, self.keeps_surfaces = name, model, first_only, keeps_surfaces
        self.image, self.touch, self.charts, self.has_charts = model.image, model.touch, model.touch, model.has_charts

    @property
    def inputs(self) -> Mapping[str, Any]:
        """Name the image and whether it takes touch."""
        return {"image": self.image, "touch": self.touch}

    def cases(self, available: int, numbers: Sequence[int]) -> list[Case]:
        """List the cases of its inputs."""
        cases = make_cases(available, numbers, touch=self.touch, occluded=self.image == "occluded")
        return [replace(case, firsts=(0,)) for case in cases if case.first == 0] if self.first_only else cases

    def observe(self, objects: ObjectRows, object_id: str, case: Case) -> Observation:
        """Read its input."""
        return stored_observation(objects, object_id, case.grasps or (case.first,), self.model.config)

    def reconstruct(self, objects: ObjectRows, work: Sequence[tuple[str, Case]]) -> list[Reconstruction]:
        """Reconstruct a batch."""
        return self.model.reconstruct([self.observe(objects, object_id, case) for object_id, case in work])

    def remarks(self) -> Iterable[str]:
        """Report nothing."""
        return ()


def make_cases(
    available: int,  # grasps per object
    numbers: Sequence[int],  # of grasps to evaluate; those above `available` are skipped
    *,
    touch: bool,  # the network takes touches
    occluded: bool,  # the network takes the occluded image
) -> list[Case]:
    """List the cases of a network.

    A network without touch gives the same result for any number of grasps, and without the occluded image for any grasp.
    All grasps together are the same input whichever comes first.
    """
    every = tuple(range(available))
    if not touch:
        return [Case(first, (), 1, (first,)) for first in every] if occluded else [Case(0, (), 1, every)]
    cases = []
    for number in (number for number in numbers if number <= available):
        if number == available and not occluded:
            cases.append(Case(0, every, number, every))
            continue
        for first in every:
            cases.append(Case(first, tuple((first + step) % available for step in range(number)), number, (first,)))
    return cases
