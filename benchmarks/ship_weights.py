"""Copy a trained network, and its U-Net, to the shipped weights, and write its card: `python -m benchmarks.ship_weights DATA [NETWORK]`."""

import shlex
import shutil
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml

from benchmarks.provenance import commit
from pipeline.config.manifest import load_manifest
from pipeline.console import errors as progress
from pipeline.errors import StageError
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.models.families import ROWS, model_name
from pipeline.models.shipped_weights import DEFAULT, SHIPPED, Error, ModelCard, TrainedOn, card_path
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location
from pipeline.store.validate import check_origins
from pipeline.training.training_stage import learned_from
from stages.evaluate.evaluation_files import SHIPPED_ROWS, SHIPPED_SCORES, read_figures, read_table
from stages.evaluate.scores import score_shipped

NOT_FOR = (
    "other kinds of objects than it was trained on, objects much larger or smaller than those, wider or narrower gels, and any use in "
    "which a wrong surface does harm: parts that were neither seen nor felt are guesses"
)
SIZES = (0.03, 0.1, 0.2, 0.4, 0.8)  # m: between two of them lie the diagonals of a size class
TARGETS = {DEFAULT: "weights", "implicit-gels": "gel-weights"}
"""The networks that ship, with the targets of `make` that train them."""
MAX_BYTES, MAX_ALL_BYTES = 6e6, 8e6
"""Size limits of a network, and of all shipped weights."""


def ship(data: Path, network: str = DEFAULT) -> ModelCard:
    """Copy a network of a data directory, and the U-Net if it takes touch charts; measure it as `report --shipped` does; write its card."""
    if network not in TARGETS:
        raise StageError(f"{network} does not ship; choose {' or '.join(TARGETS)}")
    directory, models = DataDirectory(data), SHIPPED
    sources = commit()  # before files change
    check_origins(directory, [model_name(network)])
    training = directory.folder(model_name(network))
    for name in (model_name(network), *(["models/unet"] if ROWS[network].inputs.takes_charts else [])):
        record, folder = directory.folder_record(name), directory.verified_folder(name)
        destination = models / Path(name).relative_to("models")
        for path in destination.parent.glob(f"{destination.name}[-.]*"):  # of the network that shipped before
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        for file in directory.folder(name).files:
            (copied := destination.with_name(folder.name) / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(folder / file, copied)
        destination.with_name(f"{destination.name}.json").write_bytes(record.read_bytes())
    learned = learned_from(training)
    manifests = [load_manifest(one["manifest"]) for one in learned]
    origins = {(one.kind, one.licence) for manifest in manifests for one in manifest.sources if one.split in (None, "train")}
    card = ModelCard(
        network=network,
        learned_from={manifest.name: one["items"] for manifest, one in zip(manifests, learned, strict=True)},  # an item per object
        trained_on=tuple(TrainedOn(source=source, licence=licence) for source, licence in sorted(origins)),
        commit=sources,
        command=f"make {TARGETS[network]}; settings: {_settings(training.settings)}",
        errors={},
        not_for=NOT_FOR,
    )
    _write(card)  # scores name the test objects that it has learned from
    for left_out in score_shipped(as_location(data), progress, network):
        raise StageError(f"{data}: the network was not given everything, {left_out}")
    card = card.model_copy(update={"errors": _errors(DataDirectory(data).verified_folder(SHIPPED_SCORES), network)})
    _write(card)
    check_size(models)
    return card


def _write(card: ModelCard) -> None:
    content = yaml.safe_dump(card.model_dump(mode="json"), sort_keys=False, width=140, allow_unicode=True, default_flow_style=None)
    card_path(SHIPPED, card.network).write_text(content)


def check_size(weights: Path) -> None:
    """Raise a `StageError` if a network, which is a file, or all of a folder of weights is too large."""
    sizes = {path: path.stat().st_size for path in weights.rglob("*") if path.is_file()}
    largest = max(sizes, key=sizes.__getitem__)
    for subject, size, limit in ((largest, sizes[largest], MAX_BYTES), (weights, sum(sizes.values()), MAX_ALL_BYTES)):
        if size > limit:
            raise StageError(f"{subject} has {size / 1e6:.1f} MB, at most {limit / 1e6:.0f} ship; train smaller networks")


def _errors(evaluation: Path, network: str) -> dict[str, dict[str, Error]]:
    """Read mean and median Chamfer distances, of the network by what it was given and of looked-up training objects, by class."""
    figures, objects = read_figures(evaluation), read_table(evaluation, "objects")
    categories, diagonals = np.array(objects["category"]), np.array(objects["diagonal"])
    classes = {str(name): categories == name for name in np.unique(categories)} | {"all": np.full(len(categories), True)}
    sizes = {f"{low:g} to {high:g} m": (low <= diagonals) & (diagonals < high) for low, high in pairwise(SIZES)}
    classes |= {name: mask for name, mask in sizes.items() if mask.any()}
    errors = {}
    for row, measured in figures.items():
        chamfer = TABLE_3_FACTOR * measured.per_object("chamfer") * (DIAGONAL / diagonals) ** 2
        distance = 1e3 * measured.per_object("mean_distance")
        errors[row.replace(SHIPPED_ROWS, f"{network}-")] = {
            name: Error(
                objects=int(mask.sum()),
                mean=round(float(chamfer[mask].mean()), 4),
                median=round(float(np.median(chamfer[mask])), 4),
                mm=round(float(distance[mask].mean()), 3),
                diagonals=(round(float(diagonals[mask].min()), 3), round(float(diagonals[mask].max()), 3)),
            )
            for name, mask in classes.items()
        }
    return errors


def _settings(settings: dict[str, object]) -> str:
    return " ".join(shlex.quote(f"{name}={value}") for name, value in settings.items())


if __name__ == "__main__":
    shipped = ship(Path(sys.argv[1]), *sys.argv[2:])
    print(f"{shipped.network}: learned from {shipped.learned_from}, commit {shipped.commit}")
