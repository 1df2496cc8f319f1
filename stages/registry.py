"""Every stage by name, in the order of the pipeline; a stage's module is imported when the stage is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import TypeGuard

from pipeline.stage import ObjectStage, SetStage

STAGES = {
    "sample-surfaces": "stages.sample_surfaces.stage:SampleSurfaces",
    "simulate-grasps": "stages.simulate_grasps.stage:SimulateGrasps",
    "render-vision": "stages.render_vision.stage:RenderVision",
    "simulate-touch": "stages.simulate_touch.stage:SimulateTouch",
    "train-unet": "stages.train_unet.stage:TrainUnet",
    "fit-charts": "stages.fit_charts.stage:FitCharts",
    "train-gcn": "stages.train_gcn.stage:TrainGcn",
    "evaluate": "stages.evaluate.stage:Evaluate",
}


def load_stage(name: str) -> ObjectStage | SetStage:
    """The stage called `name`, a key of `STAGES`."""
    module, _, attribute = STAGES[name].partition(":")
    stage: ObjectStage | SetStage = getattr(import_module(module), attribute)()
    return stage


def is_set_stage(stage: ObjectStage | SetStage) -> TypeGuard[SetStage]:
    """Whether a stage looks at the whole data set at once, rather than at one object after the other."""
    return hasattr(stage, "folder")
