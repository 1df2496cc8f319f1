#!/bin/sh
# Hugging Face datasets returns float64 columns as float32 in the format "numpy", except for single numbers of single rows.
#
# One expects: columns declared Array2D((4, 4), "float64") and Value("float64"), stored as float64 in Parquet, come back as float64.
# What happens: with_format("numpy") casts them to float32, while the features still say float64: a pose loses 9 of 16 digits. A number of a single
#     row, ds[0]["mass"], stays float64, so that ds[0]["mass"] and ds[:]["mass"][0] differ. with_format("arrow") keeps all digits.
# Whom it hurts: poses of sensors and hands, from which touches are computed again, are float64 for a reason.
# Versions: datasets 5.2.0, pyarrow as it brings, numpy 2.4.6. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check datasets==5.2.0 numpy==2.4.6
cd "$folder"
HF_HOME=$folder/home venv/bin/python - <<'END' 2>errors.txt || { cat errors.txt; exit 1; }
import numpy as np
import datasets

rng = np.random.default_rng(0)
poses = rng.normal(size=(3, 4, 4))
features = datasets.Features({"pose": datasets.Array2D((4, 4), "float64"), "mass": datasets.Value("float64")})
datasets.Dataset.from_dict({"pose": poses.tolist(), "mass": poses[:, 0, 0].tolist()}, features=features).to_parquet("grasps.parquet")
read = datasets.load_dataset("parquet", data_files="grasps.parquet", split="train")
batch, row = read.with_format("numpy")[:], read.with_format("numpy")[0]
exact = np.stack([np.array(pose) for pose in read.with_format("arrow")[:]["pose"].to_pylist()])
print(f"features: pose {read.features['pose'].dtype}, mass {read.features['mass'].dtype}")
print(f"with_format('numpy')[:]: pose {batch['pose'].dtype}, off by up to {np.abs(batch['pose'] - poses).max():.1e}; mass {batch['mass'].dtype}")
print(f"with_format('numpy')[0]: pose {row['pose'].dtype}; mass {row['mass'].dtype}, off by {abs(row['mass'] - poses[0, 0, 0]):.1e}")
print(f"with_format('arrow')[:]: pose off by {np.abs(exact - poses).max():.1e}")
kinds = [batch["pose"].dtype, batch["mass"].dtype, row["pose"].dtype, row["mass"].dtype]
raise SystemExit(kinds != [np.float32] * 3 + [np.float64] or not (exact == poses).all())
END
