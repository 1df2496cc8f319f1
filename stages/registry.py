"""Every stage by name, in the order of the pipeline; a stage's module is imported when the stage is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import NamedTuple, TypeGuard

from pipeline.config.settings import Settings
from pipeline.engine.stage import DatasetStage, ObjectStage


class Entry(NamedTuple):
    """Where a stage is: its room, the class in the room's `stage`, and that in its `settings`."""

    room: str
    stage: str
    settings: str


STAGES = {
    "sample-surfaces": Entry("stages.sample_surfaces", "SampleSurfaces", "SurfaceSettings"),
    "simulate-grasps": Entry("stages.simulate_grasps", "SimulateGrasps", "GraspSettings"),
    "render-vision": Entry("stages.render_vision", "RenderVision", "VisionSettings"),
    "simulate-touch": Entry("stages.simulate_touch", "SimulateTouch", "TouchSettings"),
    "train-unet": Entry("stages.train_unet", "TrainUnet", "UnetSettings"),
    "fit-charts": Entry("stages.fit_charts", "FitCharts", "ChartSettings"),
    "train-gcn": Entry("stages.train_gcn", "TrainGcn", "GcnSettings"),
    "evaluate": Entry("stages.evaluate", "Evaluate", "EvaluationSettings"),
}


def load_stage(name: str) -> ObjectStage | DatasetStage:
    """The stage called `name`, a key of `STAGES`."""
    entry = STAGES[name]
    stage: ObjectStage | DatasetStage = getattr(import_module(f"{entry.room}.stage"), entry.stage)()
    return stage


def load_settings_type(name: str) -> type[Settings]:
    """Load the type of its settings, without the stage and the libraries that it needs."""
    entry = STAGES[name]
    settings: type[Settings] = getattr(import_module(f"{entry.room}.settings"), entry.settings)
    return settings


def is_dataset_stage(stage: ObjectStage | DatasetStage) -> TypeGuard[DatasetStage]:
    """Tell a stage that looks at the whole dataset at once from one that looks at one object after the other."""
    return isinstance(stage, DatasetStage)
