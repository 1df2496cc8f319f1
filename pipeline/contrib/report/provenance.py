"""List the origin of a dataset: its records, settings and versions, and the commands that make it again."""

import shlex
from collections.abc import Iterator
from operator import attrgetter
from typing import Any

from pipeline.console import Columns, Row, Table, tabulate
from pipeline.engine.stage import ObjectStage
from pipeline.store.directory import DataDirectory
from pipeline.store.record import Provenance
from stages.registry import STAGES, assignment, load_stage, resolve


def records(directory: DataDirectory) -> dict[str, Provenance]:
    """Collect the record of every artifact, from its first shard, and of every folder, by name, in the pipeline's order."""
    origins: dict[str, Provenance] = {artifact.name: directory.collection(artifact).first.record for artifact in directory.artifacts()}
    origins |= {name: directory.folder(name) for name in directory.folders()}
    order = list(STAGES)
    return dict(sorted(origins.items(), key=lambda entry: order.index(entry[1].stage) if entry[1].stage in order else len(order)))


def outside_sweeps(origins: dict[str, Provenance]) -> dict[str, Provenance]:
    """Skip the points of sweeps, which no other stage reads."""
    return {name: origin for name, origin in origins.items() if not name.startswith("sweeps/")}


def contents_table(origins: dict[str, Provenance]) -> Table:
    """List the stage, manifest, preset, seed and key of each artifact and folder."""
    columns: Columns = {name: ("", attrgetter(name)) for name in ("stage", "manifest", "preset", "seed")}
    return tabulate("", "name", origins, columns | {"key": ("", lambda origin: origin.key[:16])})


def settings_tables(directory: DataDirectory, origins: dict[str, Provenance]) -> list[Table]:
    """List the settings that results depend on, a table per artifact or folder; those that differ from the preset's are marked."""
    tables = []
    for name, origin in origins.items():
        preset = _preset_values(directory, origin)
        rows = [
            Row([key, assignment(key, value).removeprefix(f"{key}="), "" if preset.get(key, value) == value else "set"])
            for key, value in origin.settings.items()
        ]
        if rows:
            tables.append(Table(f"{name} ({origin.stage})", ["setting", "value", "other than the preset's"], rows))
    return tables


def versions_tables(origins: dict[str, Provenance]) -> list[Table]:
    """List the package versions that made the artifacts and folders, a table per set of versions."""
    makers: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for name, origin in origins.items():
        makers.setdefault(tuple(sorted(origin.versions.items())), []).append(name)
    return [
        Table(", ".join(names), ["package", "version"], [Row([package, version]) for package, version in versions])
        for versions, names in makers.items()
    ]


def commands(directory: DataDirectory, origins: dict[str, Provenance]) -> list[str]:
    """Write the commands that make each artifact and folder again, except points of sweeps: `run` would replace the model."""
    listed = outside_sweeps(origins).values()
    return [" ".join(map(shlex.quote, _command(directory, origin))) for origin in listed if origin.stage in STAGES]


def _command(directory: DataDirectory, origin: Provenance) -> Iterator[str]:
    yield from ("vt-pipeline", "run", origin.stage)
    for option, value in ({"--manifest": origin.manifest} | origin.options).items():
        yield from (option, value)
    yield from ("--preset", origin.preset, "--seed", str(origin.seed), "--data", str(directory.root))
    if (shards := directory.shards() or 1) > 1:
        yield from ("--shards", str(shards))
    preset = _preset_values(directory, origin)
    for key, value in origin.settings.items():
        if preset.get(key) != value:
            yield from ("--set", assignment(f"{origin.stage}.{key}", value))
    for key, field in load_stage(origin.stage).settings_type.model_fields.items():
        if field.default is None and origin.speed_settings.get(key) is not None:  # such as a folder, without which a stage cannot run
            yield from ("--set", assignment(f"{origin.stage}.{key}", origin.speed_settings[key]))


def _preset_values(directory: DataDirectory, origin: Provenance) -> dict[str, Any]:
    """Read the preset's settings of a stage, with those that depend on its inputs filled in."""
    if origin.stage not in STAGES:
        return {}
    stage, settings = load_stage(origin.stage), resolve(origin.stage, origin.preset, ())
    if isinstance(stage, ObjectStage):
        inputs = [directory.collection(artifact) for artifact in stage.inputs(settings)]
        if all(collection.shards for collection in inputs):
            settings = stage.resolve_settings(settings, {collection.artifact.name: collection.first.attributes for collection in inputs})
    return settings.results()
