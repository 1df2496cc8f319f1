"""What `evaluate` left out: reconstructions that would come out the same, and what no model is shown."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pipeline.engine.stage import DatasetJob
from pipeline.models.families import GRASP_CONFIGURATIONS, load_reconstructor
from pipeline.tradeoff.explain import Count, arrays_read
from stages.evaluate.grasp_protocol import GraspProtocol, arrays_of
from stages.evaluate.settings import EvaluationSettings
from stages.evaluate.stage import Evaluate


def explain(job: DatasetJob) -> Iterator[Count]:
    """Count models, reconstructions, images and rings of an evaluation."""
    settings: EvaluationSettings = job.settings
    models = {Path(name).name: load_reconstructor(Path(name).name, folder) for name, folder in job.models.items()}
    yield Count("models evaluated", len(models), len(GRASP_CONFIGURATIONS) - len(models), "not named in `configurations`")
    yield arrays_read(arrays_of(list(models.values())), Evaluate().inputs(settings))
    protocol = GraspProtocol(job, list(models.values()))
    touched, objects = protocol.touched, len(protocol.objects)
    for model in models.values():
        cases = protocol.cases(model)
        figures = sum(len(case.firsts) for case in cases)
        same = "the same grasps in another order, or inputs that the model is not given"
        yield Count("reconstructions", len(cases) * objects, (figures - len(cases)) * objects, same, "each case once")
        sites = int(touched.sum())
        yield Count("touch sites with rings", sites, touched.size - sites, "nothing was touched there")
