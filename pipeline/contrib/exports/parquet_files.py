"""Export to Hugging Face parquet: one table per split, a row per grasp or step; images decode, arrays keep shape and type."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.contrib.exports.dataset_card import About, Facts, write_card, write_croissant
from pipeline.contrib.exports.grasp_frames import Column, GraspFrames
from pipeline.contrib.exports.sequence_frames import open_frames
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import read_description
from pipeline.formats.image_file import encode_image
from pipeline.store.storage import Location


def export_parquet(data: Location, folder: Path, about: Path | None = None, of: str | None = None) -> str:
    """Write `data/SPLIT.parquet`; of grasps with a card and Croissant metadata.

    These name what the publisher states in the YAML file `about`.
    """
    pa, frames = import_arrow(), open_frames(data, of)
    if about and not isinstance(frames, GraspFrames):
        raise InvalidInput("--about describes a dataset of grasps; slides and lifts have no card: leave it out")
    publisher = read_description("about", about, About) if about else About()
    (folder / "data").mkdir()
    schema = schema_of(frames.columns)
    with ExitStack() as opened:
        writers = {
            split: opened.enter_context(pa.parquet.ParquetWriter(folder / "data" / f"{split}.parquet", schema, compression="zstd"))
            for split in frames.object_ids
        }
        for split, rows in frames.episodes():
            writers[split].write_table(table_of(rows, frames.columns, schema))
    if not isinstance(frames, GraspFrames):
        return frames.summary
    facts = Facts(data, frames)
    write_card(data, facts, publisher, folder)
    write_croissant(facts, publisher, folder)
    missing = [name for name in ("url", "creators", "licence", "published") if not getattr(publisher, name)]
    hint = f"\nREADME.md and croissant.json lack {', '.join(missing)}, which only you know: give --about FILE with these entries"
    return frames.summary + (hint if missing else "")


def import_arrow() -> Any:
    """Import pyarrow; raise an `InvalidInput` with the command that installs it if it is missing."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise InvalidInput("parquet files need pyarrow; `pip install -c constraints.txt -e '.[export]'` installs it (50 MB)") from error
    return pyarrow


def schema_of(columns: Mapping[str, Column]) -> Any:
    """Make the Arrow schema of some columns, with their Hugging Face features as metadata."""
    pa = import_arrow()
    fields = [pa.field(name, _type(pa, column)) for name, column in columns.items()]
    features = {name: feature_of(column) for name, column in columns.items()}
    return pa.schema(fields, metadata={"huggingface": json.dumps({"info": {"features": features}})})


def feature_of(column: Column) -> dict[str, Any]:
    """Describe a column as Hugging Face's `datasets` does."""
    if column.kind == "image":
        return {"_type": "Image"}
    value = {"dtype": column.kind, "_type": "Value"}
    if len(column.shape) < 2:
        return {"feature": value, "length": column.shape[0], "_type": "Sequence"} if column.shape else value
    return {"shape": list(column.shape), "dtype": column.kind, "_type": f"Array{len(column.shape)}D"}


def table_of(frames: Sequence[Mapping[str, Any]], columns: Mapping[str, Column], schema: Any) -> Any:
    """Make a table of frames (see `Frames`) with the `schema_of` its columns; images become PNG."""
    pa = import_arrow()
    arrays = []
    for name, column in columns.items():
        write: Callable[[Any], Any] = _nested if column.kind != "image" else lambda image: {"bytes": encode_image(image), "path": None}
        arrays.append(pa.array([write(frame[name]) for frame in frames], schema.field(name).type))
    return pa.Table.from_arrays(arrays, schema=schema)


def _nested(value: Any) -> Any:
    """Split an array into lists of rows, as Arrow takes it."""
    return value if np.ndim(value) < 2 else [_nested(part) for part in value]


def _type(pa: Any, column: Column) -> Any:
    if column.kind == "image":
        return pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    arrow_type = {"bool": pa.bool_(), "string": pa.string()}.get(column.kind) or getattr(pa, column.kind)()
    if len(column.shape) == 1:
        return pa.list_(arrow_type, column.shape[0])
    for _ in column.shape:
        arrow_type = pa.list_(arrow_type)
    return arrow_type
