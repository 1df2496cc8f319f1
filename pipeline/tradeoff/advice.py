"""Advise settings for a time or an error: choose among measured settings, try the choice on this machine, choose again."""

from __future__ import annotations

import os
import shlex
import sys
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pipeline.config.manifest import load_manifest
from pipeline.config.settings import Settings
from pipeline.engine.plan import Request
from pipeline.errors import InvalidInput
from pipeline.tradeoff.choice import PRESET, Choice, Limit, Workload, within_error, within_time
from pipeline.tradeoff.measurements import load_studies
from pipeline.tradeoff.trial import measure_speed, trial_objects
from stages.registry import load_stage, resolve

STAGES_OF = {
    "dataset": ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch"),
    "train": ("sample-surfaces", "simulate-grasps", "simulate-touch", "train-unet", "fit-charts", "train-gcn"),
}
"""Stages that settings are chosen for, by target of make. The network that is trained has touch alone as input."""
TOUCH_NETWORK = "train-gcn.configuration=touch"
TRIAL_OBJECTS_PER_WORKER = 3
MOST_TRIALS = 3
"""Choices that are tried at most; the second already differs little from the first."""


@dataclass(frozen=True)
class Question:
    """What advice is asked for.

    Attributes
    ----------
    target
        A key of `STAGES_OF`.
    manifest, meshes
        The objects: a manifest, and a folder of meshes for manifests that name none.
    units, up
        Unit and up-axis of the mesh files, where they are stated.
    goal
        Seconds that all stages together may take, or the limit on one stage's error.
    """

    target: str
    manifest: str
    meshes: Path | None
    goal: float | Limit
    units: str | None = None
    up: str | None = None


@dataclass(frozen=True)
class Advice:
    """The chosen settings, one per stage, for `objects` objects."""

    question: Question
    objects: int
    choices: Sequence[Choice]

    @property
    def assignments(self) -> list[str]:
        """What differs from `PRESET`, as `--set` takes it."""
        return [line for choice in self.choices for line in choice.assignments()]

    @property
    def seconds(self) -> float:
        """Predicted time of all stages."""
        return sum(choice.seconds for choice in self.choices)

    @property
    def command(self) -> str:
        """The command that does what is advised."""
        question = self.question
        stated = {"MANIFEST": question.manifest, "OBJECTS": question.meshes, "UNITS": question.units, "UP": question.up, "PRESET": PRESET}
        stated |= {"CONFIGURATIONS": "touch" if question.target == "train" else None, "SET": " ".join(self.assignments)}
        return " ".join(["make", question.target, *(f"{name}={shlex.quote(str(value))}" for name, value in stated.items() if value)])

    def settings(self, stage: str) -> Settings:
        """Resolve all settings of a stage."""
        return resolve(stage, PRESET, [*self.assignments, TOUCH_NETWORK])

    def table(self) -> Table:
        """Lay out the choices for a console."""
        table = Table("stage", "setting", "s", "MB", "error", "at most", "", box=None, padding=(0, 2))
        for stage, entry in self.as_json()["stages"].items():
            numbers = (f"{entry['seconds']:.0f}", *(f"{entry[name]:.3g}" for name in ("megabytes", "error", "bound")))
            table.add_row(stage, escape(entry["setting"]), *numbers, escape(entry["metric"]))
        return table

    def sources(self) -> list[str]:
        """Say on which commits the figures were measured, one line per commit."""
        stages: dict[str, list[str]] = {}
        for choice in self.choices:
            stages.setdefault(choice.study.source(), []).append(choice.study.stage)
        return [f"{', '.join(names)}: measured at {source}" for source, names in stages.items()]

    def as_json(self) -> dict[str, Any]:
        """Collect everything as plain values."""
        return {
            "objects": self.objects,
            "seconds": round(self.seconds, 1),
            "stages": {choice.study.stage: self._entry(choice) for choice in self.choices},
            "set": [*self.assignments, *([TOUCH_NETWORK] if self.question.target == "train" else [])],
            "command": self.command,
        }

    def _entry(self, choice: Choice) -> dict[str, Any]:
        study, measured = choice.study, choice.measurement
        return {
            "setting": measured.label,
            "seconds": round(choice.seconds, 1),
            "megabytes": round(measured.kilobytes * (1 if study.whole_dataset else self.objects) / 1e3, 2),
            "error": measured.error,
            "bound": measured.bound,
            "metric": study.metric + study.fixed_otherwise(self.settings(study.stage)),
            "measured": study.source(),
        }


def advise(question: Question, log: Console) -> Advice:
    """Choose settings, and try them on a few of the objects, so that times are this machine's and these objects'.

    Parameters
    ----------
    question
        What advice is asked for.
    log
        Shows what is tried.

    Returns
    -------
    Advice
        With the times predicted for this machine.

    Raises
    ------
    InvalidInput
        No measured settings reach the goal, or the objects are too few to try a training.
    """
    started = time.process_time()  # the imports, which every command pays for
    known, wanted = load_studies(), STAGES_OF[question.target]
    if missing := [stage for stage in wanted if stage not in known]:
        raise InvalidInput(f"{', '.join(missing)}: not measured; run make tradeoff")
    studies = [known[stage] for stage in wanted]
    manifest = load_manifest(question.manifest).with_units(question.units, question.up)
    objects = manifest.objects(question.meshes)
    if question.target == "train" and len(objects) < 2:
        raise InvalidInput(f"{question.manifest} has {len(objects)} object; a training needs two, one of them for validation")
    workers = len(os.sched_getaffinity(0))
    some = trial_objects(objects, TRIAL_OBJECTS_PER_WORKER * workers)
    from pipeline.engine.dask_executor import Dask  # takes a second, and every command imports this module

    learned = sum(item.split == "train" for item in objects)
    workload = Workload({study.stage: learned if study.whole_dataset else len(objects) for study in studies}, workers)
    goal = question.goal
    tried: list[list[str]] = []
    with TemporaryDirectory() as folder, redirect_stdout(sys.stderr):  # standard output is for the advice
        while True:
            choices = within_error(studies, workload, goal) if isinstance(goal, Limit) else within_time(studies, workload, goal)
            advice = Advice(question, len(objects), choices)
            labels = [f"{choice.study.stage} {choice.measurement.label}" for choice in choices]
            if labels in tried or len(tried) == MOST_TRIALS:
                return advice
            log.print(escape(f"trying out {', '.join(labels)} on {len(some)} objects"))
            data, speeds = Path(folder) / str(len(tried)), {}
            for choice in choices:
                stage = load_stage(choice.study.stage)
                with Dask(workers) as executor:
                    request = Request(
                        stage, advice.settings(stage.name), manifest.name, some, PRESET, manifest.seed, data, executor=executor
                    )
                    speed = measure_speed(request, choice, log)
                speeds[stage.name] = replace(speed, startup=speed.startup + started)
            workload = replace(workload, speeds=speeds)
            tried.append(labels)
