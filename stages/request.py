"""The request of a run, from what a user names: manifest, preset, settings and places."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pipeline.config.manifest import load_manifest
from pipeline.console import CONTROLS
from pipeline.engine.plan import Request
from pipeline.errors import InvalidInput, closest_name, unknown_name
from pipeline.formats.file_content import expanded
from pipeline.store.storage import Location, as_location, on_disk
from stages.registry import STAGES, check_assignments, load_stage, resolve


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
