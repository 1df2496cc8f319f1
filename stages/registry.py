"""Every stage by name, in the order of the pipeline and then those of plugins, and the settings that a user chooses for it.

`load_stage` imports a stage's modules.
"""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.metadata import EntryPoint
from typing import Any

import yaml
from pydantic import ValidationError

from pipeline import plugins
from pipeline.config.settings import Settings, load_presets
from pipeline.engine.stage import DatasetStage, ObjectStage, Trade
from pipeline.errors import InvalidInput, PipelineError, StageError, unknown_name
from pipeline.formats.description_file import invalid_entries
from schemas.catalogue import ARTIFACTS

BUILT_IN = {
    "sample-surfaces": "stages.sample_surfaces:SampleSurfaces",
    "simulate-grasps": "stages.simulate_grasps.stage:SimulateGrasps",
    "render-vision": "stages.render_vision.stage:RenderVision",
    "simulate-touch": "stages.simulate_touch:SimulateTouch",
    "simulate-presses": "stages.simulate_presses:SimulatePresses",
    "sample-distances": "stages.sample_distances:SampleDistances",
    "train-unet": "stages.train_unet:TrainUnet",
    "train-touch": "stages.train_touch:TrainTouch",
    "fit-charts": "stages.fit_charts:FitCharts",
    "train-gcn": "stages.train_gcn:TrainGcn",
    "train-implicit": "stages.train_implicit:TrainImplicit",
    "evaluate": "stages.evaluate.stage:Evaluate",
    "read-renderings": "stages.read_renderings:ReadRenderings",
    "train-single-image": "stages.train_gcn:TrainSingleImage",
    "evaluate-single-image": "stages.evaluate.stage:EvaluateSingleImage",
}
"""Module and class of each stage. Importing the module is cheap: what a stage computes with is imported in its session."""

STAGES = {
    **{name: EntryPoint(name, value, "vt_pipeline.stages") for name, value in BUILT_IN.items()},
    **{entry.name: entry for entry in plugins.declared("stages") if entry.name not in BUILT_IN},
}
"""All stages: `BUILT_IN`, then those of plugins."""

GRASP_STAGES = [name for name in BUILT_IN if "single-image" not in name and name != "read-renderings"]
"""Stages for any manifest; the others need a manifest that names renderings."""

DATASET = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch")
"""Stages that make a dataset."""
TRADED = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch", "train-unet", "fit-charts", "train-gcn")
"""Stages that declare what they trade between speed and accuracy: their modules have a `TRADE`."""


def load_stage(name: str) -> ObjectStage | DatasetStage:
    """Load the stage called `name`, a key of `STAGES`.

    An `InvalidInput` names several packages that bring one of this name; a `StageError` says that a plugin's stage
    cannot be imported, is not a stage of this name, or writes an artifact that its package does not declare.
    """
    packages = [plugins.package_of(entry) for entry in plugins.declared("stages") if entry.name == name]
    plugins.check_unique("stage", name, ["vt-pipeline"] * (name in BUILT_IN) + packages)
    entry = STAGES[name]
    stage: ObjectStage | DatasetStage = entry.load()() if name in BUILT_IN else _load_plugin(entry)
    return stage


def _load_plugin(entry: EntryPoint) -> ObjectStage | DatasetStage:
    loaded, package = plugins.load(entry, StageError), plugins.package_of(entry)
    if not (isinstance(loaded, type) and issubclass(loaded, ObjectStage | DatasetStage) and loaded.name == entry.name):
        raise StageError(f"{entry.value} of package {package} is not an ObjectStage or DatasetStage with the name {entry.name}")
    if issubclass(loaded, ObjectStage) and ARTIFACTS.get(output := loaded.output.name) is not loaded.output:
        owner = f"; {output} is already an artifact of another package" if output in ARTIFACTS else ""
        raise StageError(f"{entry.name} of package {package} writes {output}, which its entry points `vt_pipeline.schemas` lack{owner}")
    stage: ObjectStage | DatasetStage = loaded()
    return stage


def load_trade(name: str) -> Trade:
    """Load what the stage called `name`, one of `TRADED`, trades between speed and accuracy."""
    trade: Trade = import_module(STAGES[name].module).TRADE
    return trade


def resolve(
    stage: str,  # a key of `STAGES`
    preset: str,  # its name
    assignments: Iterable[str],  # `STAGE.SETTING=VALUE`, or `SETTING=VALUE` for every stage with that setting
) -> Settings:
    """Resolve a stage's settings from defaults, preset and assignments; each overrides those before it.

    Assignments to other stages change nothing, hence one list serves all stages. For an unknown preset, stage or
    setting, or a value that is not allowed, an `InvalidInput` lists the known ones.
    """
    presets, settings = load_presets(), _settings_type(stage)
    if preset not in presets:
        raise InvalidInput(unknown_name("preset", preset, presets))
    values = {**settings.presets.get(preset, {}), **presets[preset].get(stage, {})}
    for assignment in assignments:
        name, separator, text = assignment.partition("=")
        owner, _, setting = name.rpartition(".")
        if not separator or not setting:
            raise InvalidInput(f"--set {assignment}: write STAGE.SETTING=VALUE")
        if owner and owner not in STAGES:
            raise InvalidInput(f"--set {assignment}: {unknown_name('stage', owner, STAGES)}")
        if owner == stage or (not owner and (setting in settings.model_fields or not _is_known(setting, STAGES))):
            values[setting] = _value(assignment, text)
        elif owner and not _is_known(setting, [owner]):
            raise InvalidInput(f"--set {assignment}: {unknown_name('setting', setting, _settings_type(owner).model_fields)}")
    try:
        return settings.model_validate(values)
    except ValidationError as error:
        faults = invalid_entries(error, settings.model_fields)
        if any(item["type"] == "extra_forbidden" for item in error.errors()):
            faults += f"{'' if faults.endswith('?') else '.'} Its settings are {', '.join(settings.model_fields)}"
        raise InvalidInput(f"settings of {stage}: {faults}") from error


def check_assignments(preset: str, assignments: Sequence[str], stage: str) -> None:
    """Check the assignments to other stages, as `resolve` does, before the first one, `stage`, runs.

    One that names no stage is checked for those of a dataset if `stage` is one of them.
    """
    named = {assignment.partition("=")[0].rpartition(".")[0] for assignment in assignments}
    if "" in named and stage in DATASET:
        named.update(DATASET)
    for other in STAGES:
        if other in named and other != stage:
            resolve(other, preset, assignments)


def _settings_type(name: str) -> type[Settings]:
    """Load the settings of a stage: a built-in one's even if a plugin has a stage of this name, which is an error when it runs."""
    settings: type[Settings] = (STAGES[name].load() if name in BUILT_IN else load_stage(name)).settings_type
    return settings


def _is_known(setting: str, stages: Iterable[str]) -> bool:
    for stage in stages:
        with suppress(PipelineError):  # of a plugin that cannot be used
            if setting in _settings_type(stage).model_fields:
                return True
    return False


def _value(assignment: str, text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # a date of month 99 is a ValueError
        raise InvalidInput(f"--set {assignment}: {text!r} is not valid YAML: {error}") from error
