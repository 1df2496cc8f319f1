"""Every stage by name, in the order of the pipeline and then those of plugins; settings and requests from what a user names.

`load_stage` imports a stage's modules.
"""

import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from pipeline import plugins
from pipeline.config.manifest import load_manifest
from pipeline.config.settings import Settings, load_presets
from pipeline.console import CONTROLS
from pipeline.engine.plan import Request
from pipeline.engine.stage import DatasetStage, ObjectStage, Trade
from pipeline.errors import InvalidInput, PipelineError, StageError, closest_name, unknown_name
from pipeline.formats.description_file import invalid_entries
from pipeline.formats.file_content import expanded
from pipeline.store.storage import Location, as_location, on_disk
from schemas.catalogue import ARTIFACTS

BUILT_IN = {  # module and class of each stage. Importing the module is cheap: what a stage computes with is imported in its session.
    "sample-surfaces": "stages.sample_surfaces:SampleSurfaces",
    "simulate-grasps": "stages.simulate_grasps.stage:SimulateGrasps",
    "read-grasps": "stages.simulate_grasps.read_stage:ReadGrasps",
    "render-vision": "stages.render_vision.stage:RenderVision",
    "simulate-touch": "stages.simulate_touch:SimulateTouch",
    "simulate-presses": "stages.simulate_presses:SimulatePresses",
    "simulate-slides": "stages.simulate_slides:SimulateSlides",
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

STAGES = {  # all stages: `BUILT_IN`, then those of plugins
    **{name: EntryPoint(name, value, "vt_pipeline.stages") for name, value in BUILT_IN.items()},
    **{entry.name: entry for entry in plugins.declared("stages") if entry.name not in BUILT_IN},
}

GRASP_STAGES = [name for name in BUILT_IN if "single-image" not in name and not name.startswith("read-")]
"""Stages for any manifest; the others need files of renderings or grasps."""

DATASET = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch")  # stages that make a dataset
TRADED = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch", "train-unet", "fit-charts", "train-gcn")
"""Stages that declare what they trade between speed and accuracy: their modules have a `TRADE`."""


def load_stage(name: str) -> ObjectStage | DatasetStage:
    """Load the stage called `name`, a key of `STAGES`."""
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
    if name not in TRADED:
        raise InvalidInput(unknown_name("stage", name, TRADED))
    trade: Trade = import_module(STAGES[name].module).TRADE
    return trade


def resolve(
    stage: str,  # a key of `STAGES`
    preset: str,  # its name
    assignments: Iterable[str],  # `STAGE.SETTING=VALUE`, or `SETTING=VALUE` for every stage with that setting
) -> Settings:
    """Resolve a stage's settings from defaults, preset and assignments; each overrides those before it.

    Assignments to other stages change nothing, hence one list serves all stages.
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


def assignment(name: str, value: Any) -> str:
    """Write a setting and its value as `--set` takes them."""
    text: str = yaml.safe_dump(value, default_flow_style=True, width=10**6)
    return f"{name}=" + text.rstrip().removesuffix("\n...")  # YAML ends the document after a number or a word


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


def make_request(
    stage: str,  # a key of `STAGES`
    manifest: str = "toy",  # name or path
    preset: str = "draft",
    *,
    data: str | Location | None = None,
    objects: Path | None = None,  # folder of meshes, for manifests that name none
    assignments: Iterable[str] = (),  # as `--set` takes them
    seed: int | None = None,  # by default the manifest's
    units: str | None = None,
    up: str | None = None,
    **run: Any,  # further parameters of a `Request`
) -> Request[Any]:
    """Make the request of a run; an `InvalidInput` names what cannot be used."""
    if stage not in STAGES:
        raise InvalidInput(unknown_name("stage", stage, STAGES))
    loaded, assigned = load_stage(stage), tuple(assignments)
    where = as_location(default_location(manifest, objects) / preset if data is None else data)
    _check_writable(where)
    objects = objects and expanded(objects)
    settings = resolve(stage, preset, assigned)
    check_assignments(preset, assigned, stage)
    described = load_manifest(manifest).with_units(units, up)
    items = described.objects(objects)
    if (only := run.get("only")) is not None and only not in (names := [item.object_id for item in items]):
        guess = closest_name(only, names)
        raise InvalidInput(f"manifest {described.name} has no object {only}" + (f", did you mean {guess}?" if guess else ""))
    named = {"--manifest": None if manifest == described.name else manifest, "--objects": objects, "--units": units, "--up": up}
    return Request(
        stage=loaded,
        settings=settings,
        manifest=described.name,
        objects=items,
        preset=preset,
        seed=described.seed if seed is None else seed,
        data=where,
        options={option: str(value) for option, value in named.items() if value is not None and not CONTROLS.search(str(value))},
        **run,
    )


def default_location(manifest: str, objects: Path | None) -> Path:
    """Name the default data directory; it contains the name of a folder of meshes, so that two folders do not share it."""
    return Path("data") / (Path(manifest).stem + (f"-{Path(os.path.abspath(objects)).name}" if objects else ""))


def _check_writable(data: Location) -> None:
    if folder := on_disk(data):
        existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        if not existing.is_dir():
            raise InvalidInput(f"--data {data}: {existing} is a file; name a folder")
        if existing != folder and not os.access(existing, os.W_OK):
            raise InvalidInput(f"--data {data} cannot be made: {existing} may not be written to; name another folder")
