"""Write the recipe of a dataset, and compare a dataset, remade or published, with a recipe."""

import shlex
from collections.abc import Collection as Names
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.config.folder_sources import FolderSource, ShapeNet
from pipeline.config.manifest import Manifest, load_manifest
from pipeline.config.sources import Object, fingerprint
from pipeline.console import abbreviate, pluralise
from pipeline.engine import keys
from pipeline.engine.make import plans
from pipeline.engine.plan import Request
from pipeline.errors import InvalidInput, StoreError
from pipeline.formats.description_file import description_path
from pipeline.formats.file_content import expanded
from pipeline.recipes.own_files import find_files, own_names, read_files, with_names
from pipeline.recipes.recipe import SHORT_DIGITS, Recipe, RecipeRow, StageRecipe, object_lines
from pipeline.store import digest
from pipeline.store.directory import Collection, DataDirectory, shard_of
from pipeline.store.record import ShardRecord
from pipeline.store.storage import Location
from schemas.base import Artifact
from schemas.catalogue import ARTIFACTS
from stages.registry import DATASET, load_stage


def artifacts_by_stage() -> dict[str, Artifact]:
    """Return the artifact of each stage that makes one; schemas of plugins are imported here, broken ones with an error."""
    return {artifact.stage: artifact for artifact in ARTIFACTS.values()}


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
    """Make the recipe of a dataset."""
    directory = DataDirectory(data)
    made_by = artifacts_by_stage()
    by_stage = {name: collection for name in DATASET if (collection := directory.collection(made_by[name])).shards}
    first_record = directory.collection(made_by[DATASET[0]]).first.record
    if others := {collection.first.record.stage for collection in by_stage.values()} - set(DATASET):
        raise InvalidInput(f"{', '.join(others)} read files that no recipe names; publish these files, or the dataset")
    named = manifest or first_record.options.get("--manifest", first_record.manifest)
    described = load_manifest(named).with_units(units or first_record.options.get("--units"), up or first_record.options.get("--up"))
    folder = objects or (Path(first_record.options["--objects"]) if "--objects" in first_record.options else None)
    items = described.objects(folder and expanded(folder))
    shards = directory.check_shard_count(None)
    for name, collection in by_stage.items():
        _check_current(collection.first.record, name, items, data)
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


def _check_current(record: ShardRecord, name: str, items: Sequence[Object], data: Location) -> None:
    """Raise a `StoreError` for rows that are incomplete or were made by other code or from other files: plan the recorded run again."""
    stage: Any = load_stage(name)
    settings = stage.settings_type.model_validate(record.settings | record.speed_settings)
    for plan in plans(Request(stage, settings, record.manifest, items, record.preset, record.seed, data)):
        if not plan.up_to_date():
            if (made := plan.record) is None:
                raise StoreError(f"{plan.path} has not been made; run {name} for all shards, then write the recipe")
            version = made.versions.get("vt-pipeline")
            raise StoreError(
                f"{plan.path} is out of date: {name} of vt-pipeline {version} made it with code, files or manifest that have changed "
                f"since, or in part. Run `vt-pipeline run {name} --data {shlex.quote(str(data))}` again, install that version, or state "
                "its --manifest, --objects, --units and --up; then write the recipe"
            )


def _check_sources(surfaces: Collection, items: Sequence[Object]) -> None:
    """Raise a `StoreError` for rows with another licence or file name than the manifest's: they would not be made again as they are."""
    for item in items:
        if surfaces.failure(item.object_id) is not None:
            continue
        row = surfaces.view(item.object_id)
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
    recipe_names = {own: names[description_path(kind, own).resolve()] for kind, own in own_names(record.settings)}
    return StageRecipe(
        settings=with_names(record.settings, lambda _, own: recipe_names.get(own, own)),  # as the recipe names its files
        schema_version=record.schema_version,
        code=keys.code_hash(stage),
        files=keys.assets_digest(stage.assets(settings)),
        constants=record.constants_digest,
        roots=_roots_of(collection, list(collection), record.constants_digest, shards),
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


def _roots_of(
    collection: Collection,
    names: Iterable[str],  # of its objects
    constants: str,  # digest of the arrays without an object dimension
    shards: int,  # to compute with, whatever number they are stored in
) -> tuple[str, ...]:
    """Compute the root of each shard."""
    members: list[list[tuple[str, str]]] = [[] for _ in range(shards)]
    for name in names:
        members[shard_of(name, shards)].append((name, f"{collection.row(name).digest} {collection.row(name).split}"))
    return tuple(digest.of_rows(rows, {"constants": constants}) for rows in members)


@dataclass
class Comparison:
    """How a data directory differs from a recipe."""

    compared: int = 0  # number of rows compared
    # objects by the first stage in which their row differs
    differing: dict[str, list[str]] = field(default_factory=dict)
    following: int = 0  # number of rows of later stages that differ too
    absent: dict[str, list[str]] = field(default_factory=dict)  # objects without a row, by stage
    remarks: list[str] = field(default_factory=list)  # other differences, as sentences

    @property
    def equal(self) -> bool:
        """Whether nothing differs."""
        return not (self.differing or self.absent or self.remarks)


def compare(
    recipe: Recipe,
    directory: DataDirectory,  # remade or published; only records are read: `validate` compares arrays with these
    names: Names[str] | None = None,  # only the rows of these objects, without the roots; by default all
) -> Comparison:
    """Compare the digests of a data directory's records with those of a recipe."""
    comparison, differing_before, made_by = Comparison(), set[str](), artifacts_by_stage()
    selected = recipe.rows.keys() if names is None else names
    for number, (stage, expected) in enumerate(recipe.stages.items()):
        if stage not in made_by:
            raise InvalidInput(f"no artifact here is made by {stage}, which the recipe has; use the version that wrote it")
        collection = directory.collection(made_by[stage])
        stored = set(collection)
        present = [name for name in selected if name in stored]
        if len(present) < len(selected):
            comparison.absent[stage] = [name for name in selected if name not in stored]
        if not present:
            continue
        comparison.compared += len(present)
        differing = [name for name in present if not collection.row(name).digest.startswith(recipe.rows[name].digests[number])]
        constants = collection.first.record.constants_digest
        if constants != expected.constants:
            comparison.remarks.append(f"{stage}: the arrays that all objects share differ")
        if names is None and len(present) == len(selected):
            if extra := sorted(stored - recipe.rows.keys()):
                comparison.remarks.append(f"{stage}: {pluralise(len(extra))} not in the recipe ({abbreviate(extra)})")
            roots = _roots_of(collection, recipe.rows, expected.constants, recipe.shards)  # if constants differ, a remark above says so
            wrong = {shard for shard, root in enumerate(roots) if root != expected.roots[shard]}
            if unexplained := sorted(map(str, wrong - {shard_of(name, recipe.shards) for name in differing})):
                comparison.remarks.append(
                    f"{stage}: each row agrees, but not the root of shard {abbreviate(unexplained)}: a root, or the split of an object, is "
                    "wrong in the recipe"
                )
        if newly_differing := [name for name in differing if name not in differing_before]:
            comparison.differing[stage] = newly_differing
        comparison.following += len(differing) - len(newly_differing)
        differing_before.update(differing)
    return comparison
