"""Describe a network's error: from its evaluation, from the card of a pretrained network, or from its training."""

import math
from pathlib import Path

import numpy as np

from pipeline.console import pluralise
from pipeline.errors import StoreError
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.networks.network_configurations import ImplicitConfig
from pipeline.models.families import ROWS, model_record, row_of
from pipeline.models.foreign_data import range_text
from pipeline.models.shipped_weights import card_path, is_like, read_card
from pipeline.reconstruct.observation_reader import ObservationReader
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import exists
from pipeline.store.validate import check_origins


def error_note(reader: ObservationReader, diagonal: float | None = None) -> str:
    """Describe the error of a reader's network on objects that it was not trained on, about as large as one of a diagonal, m, if known.

    Warn if looking up a training object is better.
    """
    models, model = reader.models, reader.model
    name = row_of(model.trained)
    if note := _by_evaluation(reader, name, diagonal):
        return note
    card = read_card(name, models) if isinstance(models, Path) and card_path(models, name).exists() else None
    if card and (error := card.error_of(name, None)):
        like = card.error_of(name, diagonal)
        unlike = f"not measured on objects of {diagonal:.2g} m; " if like is None else ""
        error = like or error
        sizes = range_text(error.diagonals, ".2g")
        mm = f"{_rms_distance(error.mean):.0f} mm (root mean square)" if error.mm is None else f"{error.mm:.1f} mm on average"
        return f"{name}: {unlike}{mm} from the surfaces of {error.objects} objects of {sizes} m that it has not seen"
    network = ROWS[name].network
    subject = name if name == network else f"{network}, over all combinations of inputs"
    advice = "" if card else "; `evaluate` compares it with looking up the nearest training object"
    return f"{subject}: {_by_training(reader, name)}{advice}"


def _by_evaluation(reader: ObservationReader, name: str, diagonal: float | None) -> str | None:
    """Compare the mean distance with that of the training object retrieved by the same inputs; None if the network was not evaluated."""
    if reader.models.name != "models":
        return None
    from stages.evaluate.baselines import BASELINE_PREFIX, LABELS, retrieved_by
    from stages.evaluate.evaluation_files import evaluation_name, read_figures, read_table

    directory, evaluated = DataDirectory(reader.models.parent), evaluation_name(reader.training_seed)
    if not exists(directory.folder_record(evaluated)):
        return None
    try:
        check_origins(directory, [evaluated])
        figures = read_figures(directory.verified_folder(evaluated))
    except StoreError:
        return None  # out of date: `evaluate` says why
    baseline_name = retrieved_by(reader.model.config.image, reader.model.config.touch)
    if name not in figures or (baseline := figures.get(baseline_name)) is None:
        return None
    diagonals = read_table(directory.verified_folder(evaluated), "objects")["diagonal"]
    alike = np.array([diagonal is None or is_like(diagonal, (size, size)) for size in diagonals])
    unlike = "" if alike.any() else f"not measured on objects of {diagonal:.2g} m; "
    alike |= not alike.any()
    ours, theirs = (1e3 * float(rows.per_object("mean_distance")[alike].mean()) for rows in (figures[name], baseline))
    nearer = "" if ours < theirs else "warning: worse than looking up: "
    objects = f"{pluralise(int(alike.sum()), 'test object')} of {range_text(diagonals[alike], '.2g')} m"
    return (
        f"{nearer}{name}: {unlike}{ours:.1f} mm from the surfaces of {objects} on average, with one grasp of each; "
        f"the {LABELS[baseline_name.removeprefix(BASELINE_PREFIX)]} in its place: {theirs:.1f} mm"
    )


def _by_training(reader: ObservationReader, name: str) -> str:
    """Convert the validation loss of the best epoch to mm."""
    model = reader.model
    path = reader.models / model_record(name, reader.training_seed)
    try:
        loss = float(DataDirectory(path.parent).folder(path.stem).facts["best"]["loss"])
    except (KeyError, TypeError, ValueError) as error:
        raise StoreError(f"{path}: it lacks the validation loss of a training; delete it and train the model again") from error
    if isinstance(model.config, ImplicitConfig):
        return f"signed distances near validation objects, scaled to 0.5 m, are wrong by {1e3 * loss * model.config.band:.1f} mm on average"
    if model.has_charts:
        return f"{_rms_distance(loss):.1f} mm (root mean square) from the surfaces of validation objects, scaled to 0.5 m"
    return f"validation loss {loss:.3g}"


def _rms_distance(chamfer: float) -> float:
    """Convert a Chamfer distance, in Table 3's unit, to the root mean square distance of one direction, mm."""
    return 1e3 * math.sqrt(chamfer / (2 * TABLE_3_FACTOR))
