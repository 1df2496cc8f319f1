"""Write the recipe of a dataset."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.config.folder_sources import FolderSource, ShapeNet
from pipeline.config.manifest import Manifest, Object, load_manifest
from pipeline.config.sources import fingerprint
from pipeline.console import abbreviate
from pipeline.engine import keys
from pipeline.engine.make import plans
from pipeline.engine.plan import Request
from pipeline.engine.stage import ObjectStage
from pipeline.errors import InvalidInput, StoreError
from pipeline.formats.file_content import expanded
from pipeline.recipes.own_files import find_files, own_names, own_path, read_files, with_names
from pipeline.recipes.recipe import SHORT_DIGITS, Recipe, RecipeRow, StageRecipe, object_lines, roots_of
from pipeline.store import digest
from pipeline.store.directory import Collection, DataDirectory
from pipeline.store.record import ShardRecord
from pipeline.store.storage import Location
from schemas.catalogue import ARTIFACTS
from stages.registry import DATASET, load_stage


def source_hash(source: Mapping[str, Any]) -> str:
    """Compute the hash by which a recipe identifies an object's source.

    It is the SHA-256 of its file, and after a + the first digits of a hash of the files that this one names; for a toy
    object, after a ~ those of the hash of its code and seed.
    """
    if "file" not in source:
        return f"~{digest.of_json(keys.source_key(dict(source)))[:SHORT_DIGITS]}"
    content = fingerprint(dict(source))["file"]
    return f"{content['sha256']}" + (f"+{digest.of_json(content['companions'])[:SHORT_DIGITS]}" if content["companions"] else "")


def recipe_of(
    data: Location,  # its stages, or the first of them, have made all objects
    manifest: str | None = None,  # name or path; by default what the records say
    objects: Path | None = None,  # folder of meshes; it, `units` and `up` are by default what the records say
    *,
    units: str | None = None,
    up: str | None = None,
    files_url: str | None = None,  # of the user's own files (hand, sensor, scene) whose SHA-256 alone is in the recipe
    full_digests: bool = False,  # give all 64 digits of every row's digest
) -> Recipe:
    """Make the recipe of a dataset.

    A `StoreError` says that it is incomplete, or was made by other code or from other files than are here; an
    `InvalidInput`, that a source, or a file of a hand, sensor or scene, cannot be published.
    """
    directory = DataDirectory(data)
    made_by = {artifact.stage: artifact for artifact in ARTIFACTS.values()}
    stage_names = [name for name in DATASET if made_by[name].name in directory.artifact_names()]
    by_stage = {name: collection for name in stage_names if (collection := directory.collection(made_by[name])).shards}
    if DATASET[0] not in by_stage:
        raise StoreError(f"{data}: {DATASET[0]} has made nothing here; name a data directory")
    first_record = by_stage[DATASET[0]].first.record
    named = manifest or first_record.options.get("--manifest", first_record.manifest)
    described = load_manifest(named).with_units(units or first_record.options.get("--units"), up or first_record.options.get("--up"))
    folder = objects or (Path(first_record.options["--objects"]) if "--objects" in first_record.options else None)
    items = described.objects(folder and expanded(folder))
    shards = directory.check_shard_count(None)
    for name, collection in by_stage.items():
        _check_current(_request_like(collection.first.record, name, items, data))
    _check_sources(by_stage[DATASET[0]], items)
    description_files = find_files(collection.first.record.settings for collection in by_stage.values())
    names = {path: name for name, path in description_files.items()}
    texts, files = read_files(description_files)
    collections = list(by_stage.values())
    records = [shard.record for collection in collections for shard in collection.shards]
    digits = 64 if full_digests else SHORT_DIGITS
    rows = [
        (item.object_id, RecipeRow(_readable_hash(item), tuple(c.row(item.object_id).digest[:digits] for c in collections)))
        for item in items
    ]
    return Recipe(
        manifest=_portable(described, folder),
        preset=first_record.preset,
        seed=first_record.seed,
        shards=shards,
        stages={name: _stage_recipe(name, collection, shards, names) for name, collection in by_stage.items()},
        versions={name: ", ".join(sorted({record.versions.get(name, "none") for record in records})) for name in first_record.versions},
        processors=tuple(sorted({kind for collection in collections for kind in collection.processors()})),
        texts=texts,
        files=files,
        files_url=files_url if files else None,
        objects=object_lines(rows),
    )


def _readable_hash(item: Object) -> str:
    try:
        return source_hash(item.source)
    except (OSError, InvalidInput) as error:
        raise InvalidInput(f"{item.object_id} cannot be published: {error}; remove its file, and run the stages again") from error


def _request_like(record: ShardRecord, name: str, items: Sequence[Object], data: Location) -> Request[ObjectStage]:
    """Make the request that repeats a record's run."""
    stage: Any = load_stage(name)
    settings = stage.settings_type.model_validate(record.settings | record.speed_settings)
    return Request(
        stage=stage, settings=settings, manifest=record.manifest, objects=items, preset=record.preset, seed=record.seed, data=data
    )


def _check_current(request: Request[ObjectStage]) -> None:
    """Raise a `StoreError` for rows that are incomplete or were made by other code or from other files."""
    for plan in plans(request):
        if not plan.up_to_date():
            if (record := plan.record) is None:
                raise StoreError(f"{plan.path} has not been made; run {request.stage.name} for all shards, then write the recipe")
            version = record.versions.get("vt-pipeline")
            raise StoreError(
                f"{plan.path} is not what {request.stage.name} makes here and now: it was made by other code (vt-pipeline {version}), of "
                "other files or manifest, or in part. Install that version, run the stage again, or state its --manifest, --objects, "
                "--units and --up, then write the recipe"
            )


def _check_sources(surfaces: Collection, items: Sequence[Object]) -> None:
    """Raise a `StoreError` for rows with another licence or file name than the manifest's: they would not be made again as they are."""
    for item in items:
        if surfaces.failure(item.object_id) is not None or not {"licence", "source_file"} <= set(row := surfaces.view(item.object_id)):
            continue
        stored, source = (str(row["licence"]), str(row["source_file"])), item.source
        file = Path(source["file"]).relative_to(source["root"]).as_posix() if "file" in source else stored[1]
        if stored != (source.get("licence", ""), file):
            raise StoreError(
                f"{surfaces.folder}: {item.object_id} has licence {stored[0]!r} and file {stored[1]!r} there, and others in the manifest; "
                f"delete that folder, run {DATASET[0]} and the later stages again, then write the recipe"
            )


def _stage_recipe(name: str, collection: Collection, shards: int, names: Mapping[Path, str]) -> StageRecipe:
    record = collection.first.record
    stage: Any = load_stage(name)
    settings = stage.settings_type.model_validate(record.settings)
    rows = {object_id: (collection.row(object_id).digest, collection.row(object_id).split) for object_id in collection}
    recipe_names = {own: names[own_path(kind, own)] for kind, own in own_names(record.settings)}
    return StageRecipe(
        settings=with_names(record.settings, lambda _, own: recipe_names.get(own, own)),  # as the recipe names its files
        schema_version=record.schema_version,
        code=keys.code_hash(stage),
        files=keys.assets_digest(stage.assets(settings)),
        constants=record.constants_digest,
        roots=roots_of(rows, record.constants_digest, shards),
    )


def _portable(manifest: Manifest, folder: Path | None) -> Manifest:
    """Remove the paths of folders from a manifest, and file checksums and counts, which the objects' hashes replace."""
    paths = [folder or source.path for source in manifest.sources if isinstance(source, FolderSource)]
    several = len(set(paths)) > 1
    if several and len({path.name for path in paths if path}) < len(set(paths)):
        raise InvalidInput(f"folders {abbreviate([str(path) for path in paths])} go by one name; give each another")
    changed = []
    for source in manifest.sources:
        update: dict[str, Any] = {"sha256": None}
        if isinstance(source, FolderSource):
            update["path"] = Path(source.path.name) if several and source.path else None
        if isinstance(source, ShapeNet):
            update["counts"] = None
        changed.append(source.model_copy(update=update))
    return manifest.model_copy(update={"sources": tuple(changed)})
