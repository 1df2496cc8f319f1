"""Write Croissant metadata of an exported dataset: JSON-LD for search engines and loaders (http://mlcommons.org/croissant/1.1)."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.contrib.exports.dataset_card import CITATION, COLLECTION, HUB_SPLITS, LIMITS, USES, About, Facts, meaning_of

CONFORMS = ("http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0")
_CROISSANT_TERMS = """annotation arrayShape citeAs column containedIn equivalentProperty excludes extract field fileProperty fileObject
fileSet format includes isArray isLiveDataset jsonPath key md5 parentField path readLines recordSet references regex repeated replace
samplingRate sdVersion separator source subField transform unArchive value"""
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "prov": "http://www.w3.org/ns/prov#",
    "conformsTo": "dct:conformsTo",
    **{name: f"cr:{name}" for name in _CROISSANT_TERMS.split()},
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
}
"""The context that the specification recommends, with a prefix for provenance."""
TYPES = {"string": "sc:Text", "int64": "sc:Integer", "bool": "sc:Boolean", "float32": "sc:Float", "float64": "sc:Float"}


def write_croissant(facts: Facts, about: About, folder: Path) -> None:
    """Write croissant.json beside the tables `data/SPLIT.parquet`: publisher, files with their SHA-256, and each column with its unit.

    Facts that only the publisher knows are omitted if `about` lacks them.
    """
    versions = facts.origins["grasps"].versions
    described = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": list(CONFORMS),
        "name": about.title or facts.name,
        "description": about.description.strip() or f"Visuotactile grasps of the objects of manifest {facts.name}.",
        "license": [*([about.licence] if about.licence else []), *(f"{name} ({count} objects)" for name, count in facts.licences.items())],
        "url": about.url,
        "creator": [{"@type": "sc:Organization", "name": name} for name in about.creators],
        "version": about.version,
        "datePublished": about.published.isoformat() if about.published else None,
        "citeAs": about.citation or CITATION,
        "keywords": ["tactile sensing", "visuotactile", "grasping", "3D reconstruction", "simulation"],
        "prov:wasGeneratedBy": {
            "@type": "prov:Activity",
            "prov:label": f"vt-pipeline {versions.get('vt-pipeline', '')}: {', '.join(origin.stage for origin in facts.origins.values())}",
        },
        "rai:dataCollection": COLLECTION,
        "rai:dataCollectionType": ["Software Collection"],
        "rai:dataCollectionMissingData": f"{facts.failed} objects of the manifest could not be processed and have no rows.",
        "rai:dataPreprocessingProtocol": ["Meshes are cleaned, turned upright and scaled to one size, unless their real sizes were kept."],
        "rai:dataLimitations": list(LIMITS[:-1]),
        "rai:dataBiases": [LIMITS[-1]],
        "rai:dataUseCases": [USES],
        "rai:personalSensitiveInformation": ["None: objects are meshes, and nothing of any person was recorded."],
        "distribution": [_file(folder, split) for split in facts.grasps],
        "recordSet": [_records(facts, split) for split in facts.grasps],
    }
    stated = {name: value for name, value in described.items() if value not in (None, [])}
    (folder / "croissant.json").write_text(json.dumps(stated, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _file(folder: Path, split: str) -> dict[str, Any]:
    path = folder / "data" / f"{split}.parquet"
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return {
        "@type": "cr:FileObject",
        "@id": path.name,
        "name": path.name,
        "contentUrl": f"data/{path.name}",
        "contentSize": f"{path.stat().st_size} B",
        "encodingFormat": "application/x-parquet",
        "sha256": sha256,
    }


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
        unit, meaning = meaning_of(name)
        identity = f"{HUB_SPLITS[split]}/{name}"
        field: dict[str, Any] = {
            "@type": "cr:Field",
            "@id": identity,
            "name": name,
            "description": f"{meaning} Unit: {unit}.",
            "dataType": TYPES.get(column.kind, "sc:ImageObject"),
            "source": {"fileObject": {"@id": f"{split}.parquet"}, "extract": {"column": name}},
            "annotation": {
                "@type": "cr:Field",
                "@id": f"{identity}/unit",
                "dataType": "sc:Text",
                "equivalentProperty": "sc:unitText",
                "value": unit,
            },
        }
        if column.kind == "image":
            field["source"] |= {"transform": {"jsonPath": "bytes"}}
        elif column.shape:
            field |= {"isArray": True, "arrayShape": ",".join(map(str, column.shape))}
        yield field
