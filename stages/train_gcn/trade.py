"""The trade-off of `train-gcn`: the error on test objects against the time of training."""

from pathlib import Path

from pipeline.engine.trade import Trade
from pipeline.store.directory import DataDirectory
from stages.evaluate.evaluation_files import chamfer_by_object, evaluation_name


def chamfer_distances(data: Path, reference: Path) -> dict[str, float]:
    """Read the Chamfer distances x 9000 of the evaluated network, mean over numbers of grasps, by test object."""
    return chamfer_by_object(DataDirectory(data).verified_folder(evaluation_name()))


TRADE = Trade(
    metric="Chamfer distance x 9000 of test objects",
    unit="",
    candidates=({"epochs": 3}, {"epochs": 12}, {"gcn_features": 24}, {"loss_points": 500}),
    errors=chamfer_distances,
    evaluated_by="evaluate",
)
