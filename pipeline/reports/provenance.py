"""Where a dataset comes from: what lies where, the settings, the versions, and the commands that make it again."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from typing import Any

import yaml

from pipeline.console import Row, Table
from pipeline.store.directory import DataDirectory
from pipeline.store.record import Provenance
from schemas.catalogue import ARTIFACTS
from stages.registry import STAGES, resolve


def records(directory: DataDirectory) -> dict[str, Provenance]:
    """The record of every artifact and folder that has been made, by name, in the pipeline's order; of an artifact, a shard's."""
    collections = {name: directory.collection(artifact) for name, artifact in ARTIFACTS.items()}
    found: dict[str, Provenance] = {name: one.first.record for name, one in collections.items() if one.shards}
    found |= {name: directory.folder(name) for name in directory.folders()}
    order = list(STAGES)
    return dict(sorted(found.items(), key=lambda entry: order.index(entry[1].stage) if entry[1].stage in order else len(order)))


def contents_table(found: dict[str, Provenance]) -> Table:
    """List what has been made: by which stage, from which manifest, with which preset and seed."""
    rows = [Row([name, one.stage, one.manifest, one.preset, str(one.seed), one.key[:16]]) for name, one in found.items()]
    return Table("", ["name", "stage", "manifest", "preset", "seed", "key"], rows)


def settings_tables(found: dict[str, Provenance]) -> list[Table]:
    """List the settings that results depend on, a table per artifact or folder; those that differ from the preset's are marked."""
    tables = []
    for name, one in found.items():
        usual = _preset_values(one)
        rows = [Row([key, _plain(value), "" if usual.get(key) == value else "set"]) for key, value in one.settings.items()]
        if rows:
            tables.append(Table(f"{name} ({one.stage})", ["setting", "value", "other than the preset's"], rows))
    return tables


def versions_tables(found: dict[str, Provenance]) -> list[Table]:
    """List the versions that computed, a table per set of versions."""
    makers: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for name, one in found.items():
        makers.setdefault(tuple(sorted(one.versions.items())), []).append(name)
    return [
        Table(", ".join(names), ["package", "version"], [Row([package, version]) for package, version in versions])
        for versions, names in makers.items()
    ]


def commands(directory: DataDirectory, found: dict[str, Provenance]) -> list[str]:
    """Write the commands that make it again, one per artifact and folder."""
    return [" ".join(map(shlex.quote, _command(directory, one))) for one in found.values() if one.stage in STAGES]


def _command(directory: DataDirectory, one: Provenance) -> Iterator[str]:
    yield from ("vt-pipeline", "run", one.stage, "--manifest", one.manifest, "--preset", one.preset)
    yield from ("--seed", str(one.seed), "--data", str(directory.root))
    usual = _preset_values(one)
    for key, value in one.settings.items():
        if usual.get(key) != value:
            yield from ("--set", f"{one.stage}.{key}={_plain(value)}")


def _preset_values(one: Provenance) -> dict[str, Any]:
    return resolve(one.stage, one.preset, ()).results() if one.stage in STAGES else {}


def _plain(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True, width=10**6).removesuffix("\n").removesuffix("\n...")
