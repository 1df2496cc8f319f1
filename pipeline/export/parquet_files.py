"""Export to Hugging Face parquet: one table per split, a frame per grasp; lossless."""

from __future__ import annotations

from pathlib import Path

from pipeline.console import Meter, errors
from pipeline.export.arrow_tables import import_arrow, schema_of, table_of
from pipeline.export.grasp_frames import GraspFrames

CARD = """---
configs:
- config_name: default
  data_files:
{files}
---

Grasps made by vt-pipeline, a row per grasp. Poses are 4 × 4, metres, world frame; `depth.FINGER` is the distance from the sensor plane in
metres, infinite where nothing is met. Images are PNG. Nothing was rounded.
"""


def write_parquet(frames: GraspFrames, folder: Path) -> int:
    """Write `data/SPLIT.parquet` and a README that tells Hugging Face which is which; returns the number of frames."""
    pa = import_arrow()
    (folder / "data").mkdir(parents=True, exist_ok=True)
    schema, count = schema_of(frames.columns), 0
    names = {"train": "train", "valid": "validation", "test": "test"}
    with Meter(errors, "export", sum(map(len, frames.object_ids.values())), "objects") as meter:
        for split, ids in frames.object_ids.items():
            with pa.parquet.ParquetWriter(folder / "data" / f"{split}.parquet", schema, compression="zstd") as writer:
                for object_id in ids:
                    made = list(frames.frames(object_id, split))
                    writer.write_table(table_of(made, frames.columns))
                    count += len(made)
                    meter.advance()
    files = "\n".join(f"  - split: {names[split]}\n    path: data/{split}.parquet" for split in frames.object_ids)
    (folder / "README.md").write_text(CARD.format(files=files))
    return count
