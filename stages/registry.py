"""Every stage by name, in the order of the pipeline; a stage's module is imported when the stage is asked for."""

from __future__ import annotations

from importlib import import_module

from pipeline.stage import Stage

STAGES = {
    "sample-surfaces": "stages.sample_surfaces.stage:SampleSurfaces",
    "simulate-grasps": "stages.simulate_grasps.stage:SimulateGrasps",
    "render-vision": "stages.render_vision.stage:RenderVision",
    "simulate-touch": "stages.simulate_touch.stage:SimulateTouch",
}


def load_stage(name: str) -> Stage:
    """The stage called `name`, a key of `STAGES`."""
    module, _, attribute = STAGES[name].partition(":")
    stage: Stage = getattr(import_module(module), attribute)()
    return stage
