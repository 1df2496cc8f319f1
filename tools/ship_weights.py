"""Copy a trained network, the U-Net that it needs and a card to where weights ship: `python -m tools.ship_weights DATA [MODELS]`."""

from __future__ import annotations

import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import yaml

from benchmarks.provenance import commit
from pipeline.config.manifest import load_manifest
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StageError
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.models.families import ROWS, model_name
from pipeline.models.shipped_weights import DEFAULT, SENSORS, SHIPPED, Error, ModelCard, TrainedOn, card_path
from pipeline.store.directory import DataDirectory
from stages.evaluate.evaluation_files import evaluation_name, read_figures, read_table

NOT_FOR = (
    "other kinds of objects than it was trained on, objects larger than half a metre, other sensors, and any use in which a wrong surface "
    "does harm: parts that were neither seen nor felt are guesses"
)
MAX_BYTES = 5e6
"""Of all that ships."""


def ship(data: Path, models: Path = SHIPPED, network: str = DEFAULT) -> ModelCard:
    """Copy a network with the U-Net of a data directory, and write its card from the evaluation there."""
    directory, sources = DataDirectory(data), commit()  # before files change
    directory.check_origins([model_name(network), evaluation_name()])
    for old in models.glob("*"):
        if old.name != SENSORS:  # which has a command of its own
            shutil.rmtree(old) if old.is_dir() else old.unlink()
    for name in (model_name(network), "models/unet"):
        record, folder = directory.folder_record(name), directory.whole_folder(name)
        there = models / Path(name).relative_to("models")
        for file in directory.folder(name).files:
            (copied := there.with_name(folder.name) / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(folder / file, copied)
        there.with_name(f"{there.name}.json").write_bytes(record.read_bytes())
    record_of_network = directory.folder(model_name(network))
    learned = ObjectRows(data, ["points"], "train")
    manifest = load_manifest(record_of_network.options.get("--manifest", record_of_network.manifest))
    card = ModelCard(
        network=network,
        manifest=manifest.name,
        objects=len(learned),
        trained_on=tuple(
            TrainedOn(source=source.kind, licence=source.licence) for source in manifest.sources if source.split in (None, "train")
        ),
        commit=sources,
        command=f"make weights; settings: {_settings(record_of_network.settings)}",
        errors=_errors(directory.whole_folder(evaluation_name()), network),
        not_for=NOT_FOR,
    )
    card_path(models, network).write_text(yaml.safe_dump(card.model_dump(mode="json"), sort_keys=False, width=140, allow_unicode=True))
    check_size(models)
    return card


def check_size(weights: Path) -> None:
    """Raise a `StageError` where more lies in a folder than may ship."""
    if (size := sum(path.stat().st_size for path in weights.rglob("*") if path.is_file())) > MAX_BYTES:
        raise StageError(f"{weights} holds {size / 1e6:.1f} MB, at most {MAX_BYTES / 1e6:.0f} ship; train smaller networks")


def _errors(evaluation: Path, network: str) -> dict[str, dict[str, Error]]:
    """Read mean and median Chamfer distances by row and class."""
    figures, categories = read_figures(evaluation), np.array(read_table(evaluation, "objects")["category"])
    classes = {str(name): categories == name for name in np.unique(categories)} | {"all": np.full(len(categories), True)}
    errors = {}
    for row in [name for name, (of, _) in ROWS.items() if of == network] or [network]:
        if row in figures:
            chamfer = TABLE_3_FACTOR * figures[row].per_object("chamfer")
            errors[row] = {
                name: Error(
                    objects=int(who.sum()), mean=round(float(chamfer[who].mean()), 4), median=round(float(np.median(chamfer[who])), 4)
                )
                for name, who in classes.items()
            }
    return errors


def _settings(settings: dict[str, object]) -> str:
    return " ".join(shlex.quote(f"{name}={value}") for name, value in settings.items())


if __name__ == "__main__":
    shipped = ship(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else SHIPPED)
    print(f"{shipped.network}: {shipped.objects} objects of {shipped.manifest}, commit {shipped.commit}")
