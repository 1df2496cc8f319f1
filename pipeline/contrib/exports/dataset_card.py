"""Write the card of an exported dataset, for readers. Croissant metadata says the same to programs."""

import datetime
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field
from rich.markup import escape

from pipeline.config.manifest import without_controls
from pipeline.console import errors
from pipeline.contrib.exports.grasp_frames import Column, GraspFrames
from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.drawing.contact_sheet import SHOWN, draw_contact_sheet
from pipeline.drawing.picture_sheet import spread_evenly
from pipeline.entries import Entries
from pipeline.errors import PipelineError
from pipeline.store.directory import DataDirectory
from pipeline.store.record import Provenance
from pipeline.store.storage import Location
from pipeline.tables.touch_tables import read_touches, touch_tables
from schemas.catalogue import ARTIFACTS, artifact_of
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES

PICTURE = "contact-sheet.png"
SHOWN_OBJECTS = 3

HUB_SPLITS = {"train": "train", "valid": "validation", "test": "test"}
"""The names that Hugging Face gives the splits."""
CITATION = """@inproceedings{smith2020shape,
  title = {{3D} Shape Reconstruction from Vision and Touch},
  author = {Smith, Edward J. and Calandra, Roberto and Romero, Adriana and Gkioxari, Georgia and
            Meger, David and Malik, Jitendra and Drozdzal, Michal},
  booktitle = {Advances in Neural Information Processing Systems},
  volume = {33},
  year = {2020}
}"""
"""The paper whose dataset this project rebuilds; cited unless the publisher names another."""
COLLECTION = (
    "Simulated, without people or places: a robot hand closes on the normalised mesh of each object in a physics engine; cameras are "
    "rendered, and tactile images are computed from the depth of the object's surface in the gel."
)
LIMITS = (
    "Objects do not move while they are grasped, and their mass and friction play no part unless a test of the grasps was asked for.",
    "A gel is soft only in its tactile image: it neither deforms nor shears, and sensor noise is that of the sensor file, by default none.",
    "Materials are the colours and textures of the mesh files; lamps and background are those of one scene.",
    "Figures of touch success are those of the kept grasps, the best of several attempts per object.",
    "Categories, shapes and sizes are those of the sources: nothing balances them.",
)
USES = (
    "Learning and measuring reconstruction of shape from vision and touch; prediction of depth from tactile images; grasps in simulation."
)


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
    """Facts about a data directory whose grasps are exported, for its card."""

    def __init__(self, data: Location, frames: GraspFrames) -> None:
        directory = DataDirectory(data)
        collections = {name: directory.collection(ARTIFACTS[name]) for name in SHOWN}
        self.columns = frames.columns
        self.objects = {split: len(names) for split, names in frames.object_ids.items()}  # exported, by split
        self.grasps = {split: count * frames.grasps for split, count in self.objects.items()}  # exported, by split
        self.licences = _licences(directory, frames.rows.object_ids)  # of the meshes, with the number of objects
        self.failed = len(directory.collection(GRASPS)) - len(frames.rows.object_ids)  # objects without a row
        self.origins = {name: collection.first.record for name, collection in collections.items() if collection.shards}
        self.name = self.origins["grasps"].manifest
        self.tables = touch_tables(replace(read_touches(data), paper=False))

    @property
    def total(self) -> int:
        """The number of grasps."""
        return sum(self.grasps.values())


def _licences(directory: DataDirectory, names: Sequence[str]) -> dict[str, int]:
    surfaces = directory.collection(SURFACES)
    recorded = surfaces.shards and surfaces.first.has("licence")
    counts = Counter(str(surfaces.view(name)["licence"]) if recorded else "" for name in names)
    return {licence or "not recorded": count for licence, count in counts.most_common()}


def meaning_of(column: str) -> tuple[str, str]:
    """Describe a column: its unit and what it holds, from the array's schema."""
    if column == "grasp":
        return "1", "Number of the grasp, 0 the best."
    array, _, finger = column.partition(".")
    declared = artifact_of(array).arrays[array]
    return declared.units, declared.description + (f" Of the sensor on {finger}." if finger else "")


def write_card(data: Location, facts: Facts, about: About, folder: Path) -> None:
    """Write README.md, with a picture if images and touches were made and the hand and the scene can be drawn here."""
    drawn = {artifact.name for artifact in DataDirectory(data).artifacts()}.issuperset(SHOWN)
    if drawn:
        try:
            source = CompletedObjects(data, SHOWN)
            draw_contact_sheet(source, spread_evenly(source.object_ids, SHOWN_OBJECTS), folder / PICTURE)
        except PipelineError as error:
            errors.print(f"[yellow]warning:[/] the card has no picture: {escape(str(error))}")
            drawn = False
    (folder / "README.md").write_text(card(facts, about, picture=drawn), encoding="utf-8")


def card(facts: Facts, about: About, *, picture: bool) -> str:
    """Write a dataset card, with the head that Hugging Face reads."""
    title = about.title or facts.name
    parts = [
        _head(facts, title),
        f"# {_line(title)}",
        about.description.strip() or f"Grasps of the objects of manifest {_line(facts.name)}.",
    ]
    if picture:
        alt_text = "Objects without and with the hand, a second view, touched places, tactile images, depth maps"
        parts.append(f"![{alt_text}]({PICTURE})")
    failed = f"; {facts.failed} more failed and have none" if facts.failed else ""
    splits = [[HUB_SPLITS[split], facts.objects[split], count] for split, count in facts.grasps.items()]
    parts += [
        f"{facts.total} grasps, a row each, of {sum(facts.objects.values())} objects{failed}.",
        _table(["split", "objects", "grasps"], splits),
        "## Load",
        '```python\nimport datasets\n\ndatasets.load_dataset("PATH")["train"][0]\n```',
        "`croissant.json` says the same to programs, with the SHA-256 of each file. Images are PNG; arrays keep their type and shape, and "
        "the files round nothing. `datasets` does: rows in the formats `numpy` and `torch` hold float64 arrays as float32. Plain rows, and "
        '`with_format("numpy", dtype=numpy.float64)`, keep every digit.',
        "## Columns",
        _table(["column", "type", "shape", "unit", "meaning"], [_column(name, column) for name, column in facts.columns.items()]),
        "## Statistics",
        *(part for table in facts.tables for part in (f"**{_line(table.title)}**", _table(table.columns, map(table.text, table.rows)))),
        "## Licences",
        f"Of the dataset: {_line(about.licence) if about.licence else 'the publisher states none'}. Of the meshes:",
        _table(["licence", "objects"], [[licence, count] for licence, count in facts.licences.items()]),
        "## How it was made",
        COLLECTION,
        _table(["artifact", "settings"], [[name, _settings(origin)] for name, origin in facts.origins.items()]),
        f"Versions: {', '.join(f'{name} {version}' for name, version in facts.origins['grasps'].versions.items())}.",
        "## Limits",
        "\n".join(f"- {line}" for line in LIMITS),
        "## Citation",
        f"```bibtex\n{(about.citation or CITATION).strip()}\n```",
    ]
    return "\n\n".join(parts) + "\n"


def _head(facts: Facts, title: str) -> str:
    files = "\n".join(f"  - split: {HUB_SPLITS[split]}\n    path: data/{split}.parquet" for split in facts.grasps)
    sizes = [(1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"), (1e7, "1M<n<10M")]
    size = next((name for limit, name in sizes if facts.total < limit), "n>10M")
    lines = [
        *("---", f"pretty_name: {json.dumps(title)}", "license: other", "tags: [tactile, grasping, robotics, 3d, croissant]"),
        *(f"size_categories: [{json.dumps(size)}]", "configs:", "- config_name: default", "  data_files:", files, "---"),
    ]
    return "\n".join(lines)


def _column(name: str, column: Column) -> list[object]:
    unit, meaning = meaning_of(name)
    named = f" Along the first axis: {', '.join(column.names)}." if column.names else ""
    return [f"`{name}`", column.kind, " × ".join(map(str, column.shape)), unit, meaning + named]


def _settings(origin: Provenance) -> str:
    return ", ".join(f"{name} {json.dumps(value)}" for name, value in origin.settings.items()) + f", seed {origin.seed}"


def _table(columns: Sequence[object], rows: Any) -> str:
    lines = [list(map(_line, columns)), ["---"] * len(columns), *(list(map(_line, row)) for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _line(text: object) -> str:
    """Escape untrusted text for a line of Markdown."""
    return " ".join(str(text).replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace("[", "\\[").split())
