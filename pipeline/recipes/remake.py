"""Make a dataset again from its recipe; everything is checked before anything runs."""

import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import JsonValue, ValidationError

from pipeline.config.folder_sources import FolderSource
from pipeline.config.manifest import Manifest
from pipeline.config.settings import Settings, load_presets
from pipeline.config.sources import Object
from pipeline.console import NAMED, abbreviate, pluralise
from pipeline.engine import keys
from pipeline.engine.plan import Request
from pipeline.errors import InvalidInput, unknown_name
from pipeline.formats.description_file import invalid_entries, shipped_files
from pipeline.recipes.dataset_recipe import source_hash
from pipeline.recipes.own_files import DESCRIBED, place_files, with_names
from pipeline.recipes.recipe import Recipe
from pipeline.store.record import PHYSICS, library_versions
from pipeline.store.storage import Location
from stages.registry import DATASET, load_stage, resolve


def prepare_remake(
    recipe: Recipe,  # possibly from an untrusted source
    data: Location,  # where to make it
    objects: Path | None = None,  # folder of its meshes; of the folders, where the recipe names several
    descriptions: Path | None = None,  # for hand, sensor and scene files of no package; the recipe's are written there
    sample: int | None = None,  # how many objects, drawn at random
) -> list[Request[Any]]:
    """Check everything that a recipe needs before anything is made, and make the request of each stage in turn."""
    if recipe.texts or recipe.files:
        if descriptions is None:
            raise InvalidInput("the recipe has hand, sensor or scene files of its own; name a folder for them with --descriptions FOLDER")
        place_files(recipe, descriptions)
    settings = {name: _settings(recipe, name, descriptions) for name in recipe.stages}
    _check_stages(recipe)
    items = _listed(recipe, objects)
    if sample is not None and sample < len(items):
        drawn = set(secrets.SystemRandom().sample([item.object_id for item in items], sample))
        items = [item for item in items if item.object_id in drawn]
    _check_sources(recipe, items)
    name, preset, seed = recipe.manifest.name, recipe.preset, recipe.seed
    return [Request(load_stage(stage), chosen, name, items, preset, seed, data) for stage, chosen in settings.items()]


def _check_stages(recipe: Recipe) -> None:
    """Check the order of the stages: each follows those whose artifacts it reads."""
    made: set[str] = set()
    for name, expected in zip(recipe.stages, [name for name in DATASET if name in recipe.stages], strict=True):
        stage = load_stage(name)
        lacking = [artifact.stage for artifact in stage.inputs(stage.settings_type()) if artifact.stage not in made]
        if name != expected or lacking:
            raise InvalidInput(
                f"the recipe's stages must be {', '.join(DATASET)}, or some of them in this order, each with those that it reads from; "
                f"{name} is out of place"
            )
        made.add(name)


def _settings(recipe: Recipe, name: str, descriptions: Path | None) -> Settings:
    """Validate the settings of a stage, whose description files are shipped ones or the recipe's."""
    if name not in DATASET:
        raise InvalidInput(f"the recipe: {unknown_name('stage', name, DATASET)}")
    recorded = recipe.stages[name]
    stage: Any = load_stage(name)
    values = with_names(recorded.settings, lambda setting, value: _described(recipe, name, setting, value, descriptions))
    try:
        settings: Settings = stage.settings_type.model_validate(values)
    except ValidationError as error:
        faults = invalid_entries(error, stage.settings_type.model_fields)
        raise InvalidInput(f"the recipe's settings of {name}: {faults}; {_version_remedy(recipe)}") from error
    if recorded.schema_version != stage.output.version:
        raise InvalidInput(
            f"{name} writes version {stage.output.version} of {stage.output.name} here, the recipe has {recorded.schema_version}; "
            f"{_version_remedy(recipe)}"
        )
    try:
        files_digest = keys.assets_digest(stage.assets(settings))
    except OSError as error:  # a hand or sensor file of the recipe's names one that is not there
        raise InvalidInput(f"{name}: {error.filename!s:.300} cannot be read ({error.strerror}), which the recipe's files name") from error
    if files_digest != recorded.files:
        named = ", ".join(str(recorded.settings[setting]) for setting in DESCRIBED if recorded.settings.get(setting))
        raise InvalidInput(f"{name}: the files of {named or 'the stage'} are not those of the recipe; {_version_remedy(recipe)}")
    return settings


def _described(recipe: Recipe, stage: str, setting: str, value: JsonValue, descriptions: Path | None) -> JsonValue:
    shipped = shipped_files(DESCRIBED[setting])
    files = [name for name in (*recipe.texts, *recipe.files) if name.endswith((".yaml", ".yml"))]
    if value is None or (isinstance(value, str) and value in shipped):
        return value
    if descriptions is None or value not in files:
        raise InvalidInput(f"recipe: {stage}.{setting} is {value!r:.80}; {unknown_name(DESCRIBED[setting], value, [*shipped, *files])}")
    return str((descriptions / str(value)).absolute())


def _version_remedy(recipe: Recipe) -> str:
    return f"install vt-pipeline {recipe.versions.get('vt-pipeline', 'as the recipe says')}"


def _listed(recipe: Recipe, objects: Path | None) -> list[Object]:
    """List the objects, which must be those of the recipe: others would change how splits are drawn."""
    folders = [source for source in recipe.manifest.sources if isinstance(source, FolderSource)]
    named = [str(source.path) for source in folders if source.path]
    if named and objects is None:
        raise InvalidInput(f"the recipe takes meshes from folders {abbreviate(named)}; give what holds them: --objects FOLDER")
    if objects is not None and not folders:
        raise InvalidInput(f"the recipe of {recipe.manifest.name} names its own objects; leave --objects out")
    sources = [
        item.model_copy(update={"path": objects / item.path}) if objects and isinstance(item, FolderSource) and item.path else item
        for item in recipe.manifest.sources
    ]
    manifest, root = recipe.manifest.model_copy(update={"sources": tuple(sources)}), None if named else objects
    listed_ids = {item.object_id for source in manifest.sources for item in source.find(root if isinstance(source, FolderSource) else None)}
    if missing := sorted(recipe.rows.keys() - listed_ids):
        raise InvalidInput(
            f"{pluralise(len(missing))} of the recipe not found ({abbreviate(missing)}), whose files have these SHA-256: "
            f"{abbreviate([recipe.rows[name].source for name in missing])}; {_where(manifest)}"
        )
    if extra := sorted(listed_ids - recipe.rows.keys()):
        raise InvalidInput(
            f"{pluralise(len(extra))} not in the recipe ({abbreviate(extra)}) would change the splits; move their files out of {objects}"
        )
    return manifest.objects(root)


def _where(manifest: Manifest) -> str:
    """Say where sources can be obtained."""
    urls = [source.url for source in manifest.sources if source.url]
    return f"download them from {', '.join(urls)}" if urls else "the recipe names no address; ask who published it for them"


def _check_sources(recipe: Recipe, items: Sequence[Object]) -> None:
    """Compare the files of objects, and the code of toy objects, with the recipe's hashes."""
    changed: list[str] = []
    toys: list[str] = []
    for item in items:
        try:
            actual = source_hash(item.source)
        except (OSError, InvalidInput) as error:
            raise InvalidInput(f"{item.object_id} cannot be read: {error}; {_where(recipe.manifest)}") from error
        expected = recipe.rows[item.object_id].source
        if actual == expected:
            continue
        if "file" not in item.source:
            toys.append(item.object_id)
            continue
        beside = ", or a file that it names," if actual[:64] == expected[:64] else ""
        changed.append(f"{item.object_id}: {item.source['file']}{beside} has SHA-256 {actual}, the recipe says {expected}")
    if changed:
        raise InvalidInput(
            f"{pluralise(len(changed), 'source')} changed: {'; '.join(changed[:NAMED])}{'; …' if len(changed) > NAMED else ''}. "
            f"Put the files back that the dataset was made of: {_where(recipe.manifest)}"
        )
    if toys:
        raise InvalidInput(f"{abbreviate(toys)} were modelled by different code; {_version_remedy(recipe)}")


def reasons(recipe: Recipe) -> list[str]:
    """List possible reasons for rows that differ from the recipe's (other code, other libraries), with remedies."""
    installed = library_versions()
    lines = []
    if changed := [name for name, stage_recipe in recipe.stages.items() if keys.code_hash(load_stage(name)) != stage_recipe.code]:
        lines.append(f"the rows of {', '.join(changed)} were made by different code; {_version_remedy(recipe)}, of the publisher's commit")
    for name, recorded in recipe.versions.items():
        # either package of the physics engine gives the same bits
        if name == "vt-pipeline" or (name in PHYSICS and name not in installed and installed.keys() & set(PHYSICS)):
            continue
        # 2.13.0+cpu is 2.13.0
        if installed.get(name, "").partition("+")[0] not in (version.partition("+")[0] for version in recorded.split(", ")):
            lines.append(f"{name} is {installed.get(name, 'absent')} here, {recorded} there: pip install {name}=={recorded.split(', ')[0]}")
    return lines


def unusual_settings(recipe: Recipe, stage: str) -> list[str]:
    """List the settings of a stage that differ from the recipe's preset: if nothing else explains a difference, one may be wrong."""
    if recipe.preset not in load_presets():
        return []
    usual = resolve(stage, recipe.preset, ()).results()
    settings = recipe.stages[stage].settings
    return [f"{name}={value}" for name, value in settings.items() if name in usual and usual[name] not in (value, None)]
