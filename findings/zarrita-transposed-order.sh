#!/bin/sh
# zarrita returns arrays with a transpose codec in stored order, beside the shape of the logical order.
#
# One expects: get() of an array gives `data` in the order that `shape` says, as zarr-python, zarrs and tensorstore do.
# What happens: with the transpose codec (a part of the Zarr v3 core), `data` stays in stored order and `stride` says so; `shape` is the logical one.
#     Pixel [1, 2, 3, 1] of a (2, 4, 6, 3) image array, looked up by shape, is 139 in place of 118. No error; arrays without the codec are right.
# Whom it hurts: viewers in a browser that draw images by shape: channel planes are mixed into pixels, and the picture still looks like one.
# Versions: zarrita 0.7.5 and its fs store (Node.js 20), zarr 3.1.6, numpy 2.4.6. Date: 2026-11-29. Needs node and npm.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check zarr==3.1.6 numpy==2.4.6
cd "$folder"
npm init --yes >npm.log
npm install --silent zarrita@0.7.5 @zarrita/storage@0.2.0 >>npm.log
venv/bin/python - <<'END'
import numpy as np
import zarr

images = np.arange(2 * 4 * 6 * 3, dtype="uint8").reshape(2, 4, 6, 3)
for name, filters in (("plain", ()), ("transposed", (zarr.codecs.TransposeCodec(order=(0, 3, 1, 2)),))):
    stored = zarr.create_array(f"{name}.zarr", shape=images.shape, chunks=(1, 4, 6, 3), dtype="uint8", filters=filters)
    stored[:] = images
    print(f"zarr-python, {name}: pixel [1, 2, 3, 1] is {zarr.open_array(f'{name}.zarr')[1, 2, 3, 1]}")
END
cat >read.mjs <<'END'
import * as zarr from "zarrita";
import FileSystemStore from "@zarrita/storage/fs";
const seen = {};
for (const name of ["plain", "transposed"]) {
  const array = await zarr.open(new FileSystemStore(`${name}.zarr`), { kind: "array" });
  const { data, shape, stride } = await zarr.get(array);
  const [, rows, cols, channels] = shape;
  const byShape = data[((1 * rows + 2) * cols + 3) * channels + 1];
  const byStride = data[1 * stride[0] + 2 * stride[1] + 3 * stride[2] + 1 * stride[3]];
  console.log(`zarrita, ${name}: shape ${shape}, stride ${stride}; pixel [1, 2, 3, 1] is ${byShape} by shape, ${byStride} by stride`);
  seen[name] = [byShape, byStride];
}
process.exit(seen.plain[0] === 118 && seen.transposed[0] !== 118 && seen.transposed[1] === 118 ? 0 : 1);
END
node read.mjs
