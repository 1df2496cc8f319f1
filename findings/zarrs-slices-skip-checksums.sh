#!/bin/sh
# zarr-python's checksums are not checked when its pipeline is zarrs and a part of a chunk is read.
#
# One expects: with the crc32c codec, a flipped bit in a chunk is an error whatever part of the chunk is asked for, as with zarr-python's own pipeline.
# What happens: with `codec_pipeline.path = zarrs.ZarrsCodecPipeline`, which is advertised as a drop-in, whole chunks are checked and slices are
#     not: a[1, 0] returns the damaged number without an error. (zstd's own checksum is checked in both.)
# Whom it hurts: readers of training data take slices of chunks; damage on a disk becomes a wrong depth or force, although checksums are on.
# Versions: zarrs 0.2.3, zarr 3.1.6, numpy 2.4.6. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check zarrs==0.2.3 zarr==3.1.6 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import pathlib

import numpy as np
import zarr
import zarrs  # noqa: F401

numbers = np.arange(4 * 64, dtype="float32").reshape(4, 64)
stored = zarr.create_array("a.zarr", shape=numbers.shape, chunks=(1, 64), dtype="float32", compressors=[zarr.codecs.Crc32cCodec()])
stored[:] = numbers
chunk = pathlib.Path("a.zarr/c/1/0")
content = bytearray(chunk.read_bytes())
content[2] ^= 0x40  # of the first number in the chunk
chunk.write_bytes(content)
seen = {}
for pipeline in ("zarr.core.codec_pipeline.BatchedCodecPipeline", "zarrs.ZarrsCodecPipeline"):
    zarr.config.set({"codec_pipeline.path": pipeline})
    for what, selection in (("whole chunk", np.s_[1]), ("slice", np.s_[1, :8])):
        try:
            value = zarr.open_array("a.zarr", mode="r")[selection][0]
            seen[pipeline, what] = f"{value:g} in place of {numbers[1, 0]:g}"
        except Exception as error:
            seen[pipeline, what] = f"{type(error).__name__}: {error}"
        print(f"{pipeline}, {what}: {seen[pipeline, what]}")
silent = ["in place of" in answer for answer in seen.values()]
raise SystemExit(silent != [False, False, False, True])
END
