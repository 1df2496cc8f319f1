"""Write the card of an exported dataset, for readers, and its Croissant metadata, for search engines and loaders."""

import datetime
import hashlib
import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from pydantic import AfterValidator, Field

import pipeline
from pipeline.config.manifest import without_controls
from pipeline.console import print_warning
from pipeline.contrib.exports.grasp_frames import GraspFrames
from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.drawing.contact_sheet import SHOWN, draw_contact_sheet
from pipeline.drawing.picture_sheet import spread_evenly
from pipeline.entries import Entries
from pipeline.errors import PipelineError
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
from pipeline.tables.touch_tables import read_touches, touch_tables
from schemas.catalogue import ARTIFACTS
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES

ASSETS = Path(pipeline.__file__).parent / "assets" / "exports"
PICTURE = "contact-sheet.png"
SHOWN_OBJECTS = 3
HUB_SPLITS = {"train": "train", "valid": "validation", "test": "test"}  # the names that Hugging Face gives the splits
SIZES = {1e3: "n<1K", 1e4: "1K<n<10K", 1e5: "10K<n<100K", 1e6: "100K<n<1M", 1e7: "1M<n<10M", float("inf"): "n>10M"}
"""Names that Hugging Face gives numbers of grasps below a limit."""
TYPES = {"string": "sc:Text", "int64": "sc:Integer", "bool": "sc:Boolean", "float32": "sc:Float", "float64": "sc:Float"}


class About(Entries):
    """Entries that only the publisher of a dataset knows."""

    title: Annotated[str, AfterValidator(without_controls)] | None = None
    """By default the manifest's name."""
    description: str = ""
    """Which objects these are, and why."""
    creators: tuple[Annotated[str, AfterValidator(without_controls)], ...] = ()
    """Names of people or organisations."""
    url: Annotated[str, Field(pattern="^https?://[!-~]+$")] | None = None
    """The web page of the dataset."""
    licence: Annotated[str, AfterValidator(without_controls)] | None = None
    """Of the dataset as a whole, such as https://spdx.org/licenses/CC-BY-4.0; the meshes keep theirs."""
    version: Annotated[str, Field(pattern=r"^\d+\.\d+\.\d+$")] = "1.0.0"
    """Of the dataset: another MAJOR where rows changed, another MINOR where some were added."""
    published: datetime.date | None = None
    """The date."""
    citation: str | None = None
    """In BibTeX; by default the paper whose dataset these rebuild."""


class Facts:
    """Facts about a data directory whose grasps are exported."""

    def __init__(self, data: Location, frames: GraspFrames) -> None:
        directory = DataDirectory(data)
        collections = {name: directory.collection(ARTIFACTS[name]) for name in SHOWN}
        surfaces, names = directory.collection(SURFACES), frames.rows.object_ids
        licences = Counter(str(surfaces.view(name)["licence"]) for name in names)
        self.columns = frames.columns
        self.objects = {split: len(object_ids) for split, object_ids in frames.object_ids.items()}  # exported, by split
        self.grasps = {split: sum(map(frames.grasps.__getitem__, ids)) for split, ids in frames.object_ids.items()}  # exported, by split
        self.total = sum(self.grasps.values())
        self.licences = {licence or "not recorded": count for licence, count in licences.most_common()}  # of the meshes of so many objects
        self.failed = len(directory.collection(GRASPS)) - len(names)  # objects without a row
        self.origins = {name: collection.first.record for name, collection in collections.items() if collection.shards}
        self.name = self.origins["grasps"].manifest
        self.tables = touch_tables(replace(read_touches(data), paper=False))


def write_card(data: Location, facts: Facts, about: About, folder: Path) -> None:
    """Write README.md, with a picture if images and touches were made and the hand and the scene can be drawn here."""
    drawn = {artifact.name for artifact in DataDirectory(data).artifacts()}.issuperset(SHOWN)
    if drawn:
        try:
            source = CompletedObjects(data, SHOWN)
            draw_contact_sheet(source, spread_evenly(source.object_ids, SHOWN_OBJECTS), folder / PICTURE)
        except PipelineError as error:
            print_warning("warning:", f"the card has no picture: {error}")
            drawn = False
    (folder / "README.md").write_text(card(facts, about, picture=drawn), encoding="utf-8")


def card(facts: Facts, about: About, *, picture: bool) -> str:
    """Write a dataset card, with the head that Hugging Face reads."""
    options: Any = {"trim_blocks": True, "lstrip_blocks": True, "keep_trailing_newline": True}
    environment = Environment(loader=FileSystemLoader(ASSETS), undefined=StrictUndefined, **options)
    environment.filters |= {"line": _line, "json": json.dumps}
    columns = []
    for name, column in facts.columns.items():
        named = f" Along the first axis: {', '.join(column.names)}." if column.names else ""
        columns.append([f"`{name}`", column.kind, " × ".join(map(str, column.shape)), column.unit, column.meaning + named])
    settings = {
        name: ", ".join([*(f"{setting} {json.dumps(value)}" for setting, value in origin.settings.items()), f"seed {origin.seed}"])
        for name, origin in facts.origins.items()
    }
    return environment.get_template("README.md.j2").render(
        title=about.title or facts.name,
        about=about,
        facts=facts,
        fixed=_fixed_metadata(),
        size=next(name for limit, name in SIZES.items() if facts.total < limit),
        splits=[(HUB_SPLITS[split], facts.objects[split], count) for split, count in facts.grasps.items()],
        hub_splits=HUB_SPLITS,
        picture=PICTURE if picture else None,
        columns=columns,
        tables=[(table.title, table.columns, [table.text(row) for row in table.rows]) for table in facts.tables],
        settings=settings.items(),
    )


def _line(text: object) -> str:
    """Escape untrusted text for a line of Markdown."""
    return " ".join(str(text).replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace("[", "\\[").split())


def _fixed_metadata() -> dict[str, Any]:
    """Read the metadata that all exported datasets share: context, how they are made, limits."""
    metadata: dict[str, Any] = json.loads((ASSETS / "croissant.json").read_text(encoding="utf-8"))
    return metadata


def write_croissant(facts: Facts, about: About, folder: Path) -> None:
    """Write croissant.json beside the tables `data/SPLIT.parquet`: publisher, files with their SHA-256, and each column with its unit.

    It is JSON-LD as http://mlcommons.org/croissant/1.1 describes. Facts that only the publisher knows are omitted if `about` lacks them.
    """
    stages = ", ".join(origin.stage for origin in facts.origins.values())
    label = f"vt-pipeline {facts.origins['grasps'].versions.get('vt-pipeline', '')}: {stages}"
    described = _fixed_metadata() | {
        "name": about.title or facts.name,
        "description": about.description.strip() or f"Visuotactile grasps of the objects of manifest {facts.name}.",
        "license": [*([about.licence] if about.licence else []), *(f"{name} ({count} objects)" for name, count in facts.licences.items())],
        "version": about.version,
        "prov:wasGeneratedBy": {"@type": "prov:Activity", "prov:label": label},
        "rai:dataCollectionMissingData": f"{facts.failed} objects of the manifest could not be processed and have no rows.",
        "distribution": [_file(folder, split) for split in facts.grasps],
        "recordSet": [_records(facts, split) for split in facts.grasps],
    }
    stated = {
        "url": about.url,
        "creator": [{"@type": "sc:Organization", "name": name} for name in about.creators],
        "datePublished": about.published and about.published.isoformat(),
        "citeAs": about.citation,
    }
    described |= {name: value for name, value in stated.items() if value}
    (folder / "croissant.json").write_text(json.dumps(described, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _file(folder: Path, split: str) -> dict[str, Any]:
    path = folder / "data" / f"{split}.parquet"
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    described = {"contentUrl": f"data/{path.name}", "contentSize": f"{path.stat().st_size} B", "sha256": sha256}
    return {"@type": "cr:FileObject", "@id": path.name, "name": path.name, "encodingFormat": "application/x-parquet", **described}


def _records(facts: Facts, split: str) -> dict[str, Any]:
    name = HUB_SPLITS[split]
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": f"{facts.grasps[split]} grasps of {facts.objects[split]} objects.",
        "key": [{"@id": f"{name}/object_id"}, {"@id": f"{name}/grasp"}],
        "field": list(_fields(facts, split)),
    }


def _fields(facts: Facts, split: str) -> Iterator[dict[str, Any]]:
    for name, column in facts.columns.items():
        identity = f"{HUB_SPLITS[split]}/{name}"
        unit = {"@id": f"{identity}/unit", "dataType": "sc:Text", "equivalentProperty": "sc:unitText", "value": column.unit}
        field: dict[str, Any] = {
            "@type": "cr:Field",
            "@id": identity,
            "name": name,
            "description": f"{column.meaning} Unit: {column.unit}.",
            "dataType": TYPES.get(column.kind, "sc:ImageObject"),
            "source": {"fileObject": {"@id": f"{split}.parquet"}, "extract": {"column": name}},
            "annotation": {"@type": "cr:Field", **unit},
        }
        if column.kind == "image":
            field["source"] |= {"transform": {"jsonPath": "bytes"}}
        elif column.shape:
            field |= {"isArray": True, "arrayShape": ",".join(map(str, column.shape))}
        yield field
