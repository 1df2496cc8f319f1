"""What each choice in training is worth: `python -m benchmarks.tradeoff.training_choices DATA OUT [--configuration NAME] [--write]`.

Each choice changes one thing of the draft networks. It is trained with each seed, for a part of draft's epochs, in a data directory
below OUT that shares DATA's artifacts (manifest four-classes), and measured on the test objects with one grasp. What is there already
is not made again: calls with other seeds can run side by side, and a last one with `--write` puts all into docs/tradeoff.md.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.provenance import provenance
from benchmarks.tradeoff.figures import read_figures, section_rows, write_figures
from benchmarks.tradeoff.page import write_page
from benchmarks.tradeoff.runs import command
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.models.families import EVERY_CONFIGURATION, family_of, model_name
from pipeline.store.directory import DataDirectory
from pipeline.tradeoff.measurements import load_studies
from stages.evaluate import evaluation_files

COMMAND = "python -m benchmarks.tradeoff.training_choices data/four-classes/draft data/choices --seeds {} --write"
SHARED = ("surfaces", "grasps", "vision", "touch", "distances", "models/unet*", "charts")
VARIED = ("image_gain=0.2", "image_shift=10", "image_noise=3")
COMMON: dict[str, tuple[str, ...]] = {
    "as draft": (),
    "constant rate": ("schedule=constant",),
    "gradients not limited": ("gradient_limit=null",),
    "weights averaged, 0.99": ("weight_average=0.99",),
    "group normalisation": ("encoder_norm=group",),
    "colours varied": VARIED,
    "a fifth of the touches dropped": ("dropped_touches=0.2",),
    "batches of 8": ("batch_size=8",),
}
"""By name, the settings that differ from draft's."""
CHARTS = COMMON | {
    "each object once an epoch, five times the epochs": ("samples_per_object=1", "epochs=15"),
    "3000 loss points": ("loss_points=3000",),
    "seams open": ("seams=open",),
    "no edge term": ("edge_weight=0",),
    "edge 0.2": ("edge_weight=0.2",),
    "laplacian 0.5": ("laplacian_weight=0.5",),
    "bending 0.1": ("bending_weight=0.1",),
    "touch through the charts' centres": ("touch_edges=centres",),
}
IMPLICIT = COMMON | {
    "2000 queries": ("queries=2000",),
    "twice the features": ("features=256",),
}
FAMILIES = {"train-gcn": (("epochs=3",), CHARTS), "train-implicit": (("epochs=20",), IMPLICIT)}
"""By stage: how short these trainings are, and the choices."""
OF_IMAGES = {"group normalisation", "colours varied"}
OF_TOUCHES = {"a fifth of the touches dropped", "touch through the charts' centres"}
QUALITY = ("area_ratio", "dihedral", "spike", "normal_consistency")


def stage_of(configuration: str) -> str:
    """Name the stage that trains a network."""
    return f"train-{family_of(configuration)}"


def choices_of(configuration: str) -> dict[str, tuple[str, ...]]:
    """Take the choices that make a difference to a network, for what it sees and feels."""
    given, choices = EVERY_CONFIGURATION[configuration], FAMILIES[stage_of(configuration)][1]
    idle = (OF_IMAGES if given.image is None else set()) | (set() if given.touch else OF_TOUCHES)
    return {name: settings for name, settings in choices.items() if name not in idle}


def measure(source: Path, out: Path, configuration: str, choice: str, seed: int) -> dict[str, float]:
    """Train and evaluate one choice with one seed; return its figures over the test objects."""
    stage = stage_of(configuration)
    short, _ = FAMILIES[stage]
    data = out / f"{configuration} {choice} {seed}".replace(" ", "-")
    (data / "models").mkdir(parents=True, exist_ok=True)
    for path in (path for name in SHARED for path in source.glob(name)):
        if not (link := data / path.relative_to(source)).exists():
            link.symlink_to(path.resolve())
    shutil.copy(source / "dataset.json", data)
    settings = (*short, *choices_of(configuration)[choice], f"configuration={configuration}", f"training_seed={seed}")
    command(stage, Path("four-classes"), "draft", data, [f"{stage}.{one}" for one in settings], 0)
    # retrieval, which is looked up among the training objects, is the same for each choice and takes longer than the rest
    asked = (f"configurations=[{configuration}]", f"training_seed={seed}", "looked_up=1", "grasps=[1]")
    command("evaluate", Path("four-classes"), "draft", data, [f"evaluate.{one}" for one in asked], 0)
    facts = DataDirectory(data).folder(model_name(configuration, seed)).facts
    folder = DataDirectory(data).whole_folder(evaluation_files.evaluation_name(seed))
    figures = evaluation_files.read_figures(folder)[configuration]
    chamfer = TABLE_3_FACTOR * figures.per_object("chamfer")
    return {
        "seconds": facts["training_seconds"],
        "mean": chamfer.mean(),
        "median": float(np.median(chamfer)),
        **{name: float(np.mean(figures.available(name))) for name in QUALITY},
    }


def summarised(configuration: str, choice: str, found: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Summarise a choice's seeds as a row of the trade: means over the seeds, the least seconds, and the Chamfer distance of each."""
    means = {name: float(f"{np.mean([one[name] for one in found]):.4g}") for name in found[0]}
    means["seconds"] = min(one["seconds"] for one in found)  # other work only adds to them
    return {"network": configuration, "label": choice, **means, "each": [round(float(one["mean"]), 3) for one in found]}


def _place(row: Mapping[str, Any]) -> tuple[str, bool]:
    """Place a row: network by network, what nothing was changed of first."""
    return row["network"], row["label"] != "as draft"


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure choices, and put them into the trade in place of what was measured of them before."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--configuration", default="unoccluded")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--choices", nargs="+", metavar="NAME")
    parser.add_argument("--write", action="store_true", help="into docs/tradeoff.md")
    given = parser.parse_args(arguments)
    rows = []
    for choice in given.choices or choices_of(given.configuration):
        found = [measure(given.data, given.out, given.configuration, choice, seed) for seed in given.seeds]
        rows.append(summarised(given.configuration, choice, found))
        print(*rows[-1].values(), sep=" | ", flush=True)
    if given.write:
        figures, measured = read_figures(), {(row["network"], row["label"]) for row in rows}
        kept = [row for row in section_rows(figures, "training") if (row["network"], row["label"]) not in measured]
        made = provenance("", "") | {"command": COMMAND.format(" ".join(map(str, given.seeds)))}
        figures["sections"]["training"] = {"provenance": made, "rows": sorted([*kept, *rows], key=_place)}
        write_figures(figures)
        write_page(figures, load_studies().values())


if __name__ == "__main__":
    main()
