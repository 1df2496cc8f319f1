"""What each choice in training is worth. `python -m benchmarks.training_choices DATA OUT`.

Each choice is a training of the draft network with each seed, in a data directory below OUT that shares DATA's artifacts (manifest
four-classes), measured on the test objects. What is there already is not made again: calls with other seeds can run side by side, and
a last one prints the whole table.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.provenance import provenance
from benchmarks.tradeoff.runs import command
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.store.directory import DataDirectory
from stages.evaluate.evaluation_files import read_table

SHARED = ("surfaces", "grasps", "vision", "touch", "models/unet", "charts")
SHORT = ("epochs=8", "loss_points=1000")
"""Minutes per training."""
PLAIN = ("learning_rate=0.003", "schedule=constant", "gradient_limit=null", "seams=open", "edge_weight=0", "encoder_layers=12")
FALLING = ("learning_rate=0.006", "schedule=cosine", "gradient_limit=5")
CHOICES: dict[str, tuple[str, ...]] = {
    "plain": (),
    "cosine": ("schedule=cosine",),
    "cosine 6e-3": ("learning_rate=0.006", "schedule=cosine"),
    "cosine 6e-3, limit 5": FALLING,
    "… seams tied": (*FALLING, "seams=tied"),
    "… seams tied, edge 0.05": (*FALLING, "seams=tied", "edge_weight=0.05"),
    "… seams tied, edge 0.2": (*FALLING, "seams=tied", "edge_weight=0.2"),
    "… seams tied, laplacian 0.5": (*FALLING, "seams=tied", "laplacian_weight=0.5"),
    "… seams tied, bending 0.1": (*FALLING, "seams=tied", "bending_weight=0.1"),
    "… seams tied, edge 0.05, bending 0.1": (*FALLING, "seams=tied", "edge_weight=0.05", "bending_weight=0.1"),
    "… seams tied, touch to all": (*FALLING, "seams=tied", "touch_edges=all"),
    "… seams tied, touch to all, edge 0.05": (*FALLING, "seams=tied", "touch_edges=all", "edge_weight=0.05"),
}
"""By name, the settings that differ from `PLAIN`."""
QUALITY = ("area_ratio", "dihedral", "seam_gap", "spike", "normal_consistency", "crossing")


def measure(source: Path, out: Path, configuration: str, choice: str, seed: int) -> dict[str, float]:
    """Train and evaluate one choice with one seed; return its figures over the test objects."""
    data = out / f"{configuration} {list(CHOICES).index(choice)} seed {seed}".replace(" ", "-")
    for name in SHARED:
        (data / name).parent.mkdir(parents=True, exist_ok=True)
        if (source / name).exists() and not (data / name).exists():
            (data / name).symlink_to((source / name).resolve())
    shutil.copy(source / "dataset.json", data)
    settings = [
        f"train-gcn.{one.removeprefix('train-gcn.')}" for one in (*SHORT, *PLAIN, *CHOICES[choice], f"configuration={configuration}")
    ]
    manifest = Path("four-classes")
    command("train-gcn", manifest, "draft", data, settings, seed)
    # retrieval, which is looked up among the training objects, is the same for each choice and takes longer than the rest
    command("evaluate", manifest, "draft", data, [f"evaluate.configurations=[{configuration}]", "evaluate.looked_up=1"])
    facts = DataDirectory(data).folder(f"models/gcn/{configuration}").facts
    values = read_table(DataDirectory(data).whole_folder("evaluation"), f"values/{configuration}")
    chamfer = TABLE_3_FACTOR * values["chamfer"].mean(axis=1)  # (object, number of grasps)
    return {
        "seconds": facts["training_seconds"],
        "mean": chamfer[:, 0].mean(),
        "median": float(np.median(chamfer[:, 0])),
        "mean, all grasps": chamfer[:, -1].mean(),
        **{name: float(np.mean(values[name])) for name in QUALITY},
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure the choices, and print a table: the mean over seeds, and the Chamfer distance of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--configuration", default="unoccluded")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--choices", nargs="+", choices=CHOICES, default=list(CHOICES), metavar="NAME")
    given = parser.parse_args(arguments)
    print(provenance("python -m benchmarks.training_choices", "python -m benchmarks.training_choices"))
    for number, choice in enumerate(given.choices):
        found = [measure(given.data, given.out, given.configuration, choice, seed) for seed in given.seeds]
        if not number:
            print("", "choice", *found[0], "each seed", "", sep=" | ")
        means = [f"{np.mean([one[name] for one in found]):.4g}" for name in found[0]]
        print("", choice, *means, ", ".join(f"{one['mean']:.2f}" for one in found), "", sep=" | ", flush=True)


if __name__ == "__main__":
    main()
