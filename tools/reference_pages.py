"""Write the reference pages: arrays, settings, and the entries of manifests, hands, sensors, scenes and observations.

`make docs` writes those of `PAGES`; those of `SITE_PAGES` are written when the site is built.

What is above the marker in a page is written by hand; the rest is generated from `schemas/`, the stages' settings and the models of files.
"""

import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from pipeline import plugins
from pipeline.config.manifest import MESH_SOURCES, Manifest
from pipeline.config.settings import Settings, load_presets, value_text
from pipeline.config.sources import MeshSource, Source
from pipeline.formats.hand_file import HandFile
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.vision.scene import Scene
from pipeline.reconstruct.observation_file import RobotObservation
from pipeline.store.atomic import write_atomically
from schemas.base import COMMON, FIXED, Array
from schemas.catalogue import ARTIFACTS
from schemas.evaluation import GROUPS
from stages.registry import STAGES, load_stage

MARKER = "<!-- Generated below this line by `make docs`; do not edit. -->\n"


def main() -> None:
    """Bring the pages in a folder, by default `docs`, up to date."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs")
    for name, generate in PAGES.items():
        path = folder / name
        write_atomically(path, regenerated(path.read_text(encoding="utf-8"), generate()).encode())


def regenerated(page: str, generated: str) -> str:
    """Replace what is below the marker of a page."""
    by_hand, marker, _ = page.partition(MARKER)
    if not marker:
        raise ValueError(f"the page has no line {MARKER!r}; add it below what is written by hand")
    return f"{by_hand}{MARKER}\n{generated}"


# ---- docs/data-format.md


def data_format() -> str:
    """Describe every artifact and table."""
    return "\n".join([*_artifacts(), *_tables()])


def _artifacts() -> Iterator[str]:
    yield "## Arrays of every artifact\n"
    yield _array_table(COMMON)
    yield "Dimensions of one size everywhere: " + ", ".join(f"`{name}` {size}" for name, size in FIXED.items()) + ".\n"
    for artifact in ARTIFACTS.values():
        yield f"## `{artifact.name}`\n"
        yield f"{artifact.summary} Written by `{artifact.stage}`, schema version {artifact.version}.\n"
        yield _array_table({name: array for name, array in artifact.arrays.items() if name not in COMMON})
        if artifact.ragged:
            yield "Per object, in a group `meshes/OBJECT_ID` where `meshes` is the first part of the name:\n"
            yield _array_table(artifact.ragged)


def _tables() -> Iterator[str]:
    yield "## `evaluation`\n"
    yield "Zarr groups in `tables.zarr`; `predictions` and `meshes` hold one group per network.\n"
    for name, table in GROUPS.items():
        yield f"### `{name}`\n"
        yield f"{table.summary}\n"
        yield _array_table(table.arrays)


def _array_table(arrays: Mapping[str, Array]) -> str:
    rows = [(f"`{name}`", ", ".join(array.dims), array.dtype, array.units, _meaning(array)) for name, array in arrays.items()]
    return _table(("array", "dimensions", "type", "units", "meaning"), rows)


def _meaning(array: Array) -> str:
    equation = f" Equation {array.equation}." if array.equation else ""
    return array.description + equation + (" May be left out." if array.optional and not array.is_coordinate else "")


# ---- docs/settings.md


def settings() -> str:
    """Describe every setting of every stage."""
    return "\n".join(part for name in STAGES for part in _stage(name))


def _stage(name: str) -> Iterator[str]:
    stage = load_stage(name)
    defaults = stage.settings_type()
    reads = ", ".join(f"`{name}`" for name in stage.reads(defaults))
    presets = {preset: values.get(name, {}) for preset, values in load_presets().items()}
    yield f"## {name}\n"
    yield f"{stage.summary} With the default settings it reads {reads or 'mesh files'} and writes `{stage.writes(defaults)}`.\n"
    yield _table(("setting", "type", "default", "in presets", "changes", "why"), _setting_rows(stage.settings_type, presets))


def _setting_rows(kind: type[Settings], presets: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, ...]]:
    for field, info in kind.model_fields.items():
        listed = [f"{preset}: `{value_text(values[field])}`" for preset, values in presets.items() if field in values]
        yield f"`{field}`", _type(info), f"`{value_text(info.default)}`", ", ".join(listed), kind.changes(field), str(info.description)


def _type(info: FieldInfo) -> str:
    """Name a field's type and its limits."""
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    limits = [
        f"{sign} {limit:g}" for part in info.metadata for name, sign in signs.items() if (limit := getattr(part, name, None)) is not None
    ]
    return ", ".join([_type_name(info.annotation), *limits])


def _type_name(annotation: Any) -> str:
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return " or ".join(f"`{value_text(choice)}`" for choice in inner)
    if origin is Annotated:
        return _type_name(inner[0])
    if origin is tuple:
        return f"list of {_type_name(inner[0])}"
    if inner:  # a union
        return " or ".join(map(_type_name, inner))
    return "null" if annotation is NoneType else str(annotation.__name__)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"


# ---- docs/guide/own-photographs.md, docs/manifest.md and docs/hand-and-sensor.md: entries of YAML files


def hand_and_sensor_entries() -> str:
    """Describe every entry of a hand file, a sensor file and a scene file."""
    parts = []
    for title, model_type in (("A hand", HandFile), ("A sensor", Sensor), ("A scene", Scene)):
        schema = model_type.model_json_schema()
        inner = {TITLES[name]: model for name, model in schema["$defs"].items()}
        parts += [part for name, model in ({title: schema} | inner).items() for part in _entries(name, model)]
    return "\n".join(parts)


def observation_entries() -> str:
    """Describe every entry of an observation file."""
    schema = RobotObservation.model_json_schema()
    inner = ("ObservedObject", "ObservedCamera", "Intrinsics", "ObservedTouch", "Pose")
    models = {"An observation": schema} | {TITLES[name]: schema["$defs"][name] for name in inner}
    return "\n".join(part for title, model in models.items() for part in _entries(title, model))


def manifest_entries() -> str:
    """Describe every entry of a manifest; entries that several kinds of sources share are described once."""
    schema = Manifest.model_json_schema()
    models, source, meshes = dict(schema.get("$defs", {})), Source.model_json_schema(), MeshSource.model_json_schema()
    for kind in (*MESH_SOURCES.values(), plugins.named("sources", "procedural", Source)):
        described = kind.model_json_schema()
        models |= {kind.__name__: described, **described.get("$defs", {})}
    parts = [
        _entries("A manifest", schema),
        _entries(TITLES["Splits"], models["Splits"]),
        _entries("Every source", source),
        _entries("Every source of mesh files", meshes, described_model=source),
        *(_entries(TITLES[name], models[name], described_model=meshes) for name in ("Directory", "Catalogue", "ShapeNet", "Pybullet")),
        _entries(TITLES["PybulletFile"], models["PybulletFile"]),
        _entries(TITLES["Procedural"], models["Procedural"], described_model=source),
    ]
    return "\n".join(part for entries in parts for part in entries)


TITLES = {
    "ObservedObject": "`object`",
    "ObservedCamera": "`camera`",
    "Intrinsics": "`intrinsics`",
    "ObservedTouch": "`touches`",
    "Pose": "`pose`",
    "_PalmEntry": "`palm`",
    "_FingerEntry": "`fingers`",
    "_SensorMount": "`sensor` of a finger",
    "Surface": "`surface`",
    "Gel": "`gel`",
    "MarkerGrid": "`markers`",
    "Lights": "`lights`",
    "Calibration": "`calibrated`",
    "Shadow": "`shadows`",
    "Camera": "`cameras`",
    "DrawnViews": "`drawn` of a camera",
    "Lamp": "`lamp`",
    "Splits": "`splits`",
    "Directory": "`kind: directory`",
    "Catalogue": "`kind: catalogue`",
    "ShapeNet": "`kind: shapenet`",
    "Pybullet": "`kind: pybullet`",
    "PybulletFile": "`files` of `kind: pybullet`",
    "Procedural": "`kind: procedural`",
}
"""Headings of the models in observations, hands, sensors, scenes and manifests."""


def _entries(title: str, model: Mapping[str, Any], described_model: Mapping[str, Any] | None = None) -> Iterator[str]:
    """Describe a model of a YAML file, without the entries of `described_model`."""
    yield f"### {title}\n"
    yield f"{model['description']}\n"
    needed, elsewhere = model.get("required", ()), described_model["properties"] if described_model else {}
    rows = [
        (f"`{name}`", _schema_type(entry), "needed" if name in needed else _default(entry.get("default")), entry.get("description", ""))
        for name, entry in model["properties"].items()
        if name not in elsewhere
    ]
    yield _table(("entry", "type", "default", "meaning"), rows)


def _default(value: Any) -> str:
    return "" if value in (None, [], {}) or isinstance(value, dict) else f"`{value_text(value)}`"


def _schema_type(entry: Mapping[str, Any]) -> str:
    """Name the type of an entry of a JSON schema."""
    if "$ref" in entry:
        return TITLES[entry["$ref"].rpartition("/")[2]]
    if "anyOf" in entry:
        return " or ".join(_schema_type(alternative) for alternative in entry["anyOf"] if alternative != {"type": "null"})
    if choices := entry.get("enum", [entry["const"]] if "const" in entry else []):
        return " or ".join(f"`{choice}`" for choice in choices)
    if "prefixItems" in entry:
        count, inner = len(entry["prefixItems"]), _schema_type(entry["prefixItems"][0])
        return f"{count} × {inner}" if inner.endswith("s") else f"{count} {inner}s"
    if not entry:  # of any kind
        return "sources"
    if "additionalProperties" in entry:
        names = " or ".join(f"`{name}`" for name in entry.get("propertyNames", {}).get("enum", ()))
        return f"{names or 'name'}: {_schema_type(entry['additionalProperties'])}, …"
    if entry["type"] == "array":
        return f"list of {_schema_type(entry['items'])}"
    return "path" if entry.get("format") == "path" else {"string": "text", "boolean": "`true` or `false`"}.get(entry["type"], entry["type"])


SITE_PAGES = {"data-format.md": data_format, "settings.md": settings}
PAGES = {
    "manifest.md": manifest_entries,
    "hand-and-sensor.md": hand_and_sensor_entries,
    "guide/own-photographs.md": observation_entries,
}

if __name__ == "__main__":
    main()
