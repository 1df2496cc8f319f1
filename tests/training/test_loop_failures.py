"""Errors of a training, with the items that caused them."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.multiprocessing.spawn import ProcessRaisedException

from pipeline.errors import StageError
from pipeline.kernels.metrics.chamfer import chamfer
from pipeline.training.loop import read_metrics
from tests.training.regression import Batch, Regression, fit, settings


class Perfect(Regression):
    """Starts where its loss is 0 and stays so for an epoch; then it is `later`."""

    def __init__(self, later: float) -> None:
        super().__init__(plain=True)
        self.later = later

    def loss(self, network: torch.nn.Module, batch: Batch) -> torch.Tensor:
        nothing = 0 * super().loss(network, batch)
        return nothing + (self.later if self.steps > len(self) / settings().batch_size else 0)


class Steep(Regression):
    """A finite loss without a finite gradient: the root of 0."""

    def loss(self, network: torch.nn.Module, batch: Batch) -> torch.Tensor:
        return 1 + (0 * super().loss(network, batch)).sqrt()


class Refused(Regression):
    """Its loss, or its validation, asks a kernel for the distance to a point that is nowhere."""

    def __init__(self, where: str) -> None:
        super().__init__(plain=True)
        self.where = where

    def loss(self, network: torch.nn.Module, batch: Batch) -> torch.Tensor:
        return super().loss(network, batch) + self._distance("loss")

    def validate(self, network: torch.nn.Module) -> dict[str, float]:
        return {"loss": super().validate(network)["loss"] + float(self._distance("validation"))}

    def _distance(self, where: str) -> Tensor:
        return chamfer(torch.zeros(1, 3), torch.full((1, 3), math.nan if self.where == where else 0.0))


class Unmeasured(Regression):
    """Learner whose validation loss is NaN."""

    def validate(self, network: torch.nn.Module) -> dict[str, float]:
        return {"loss": math.nan}


class Few(Regression):
    """Learner with a set number of items."""

    def __init__(self, count: int, plain: bool = False) -> None:
        super().__init__(plain=plain)
        self.x = self.x[:count]


def test_training_without_items_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(StageError, match="regression: there are no items to train on"):
        fit(Few(0), tmp_path)


def test_training_on_one_item_works(tmp_path: Path) -> None:
    facts = fit(Few(1, plain=True), tmp_path, epochs=2)
    assert (facts["items"], facts["epochs"]) == (1, 2)


def test_finite_loss_after_an_epoch_of_zero_loss_is_accepted(tmp_path: Path) -> None:
    fit(Perfect(later=0.5), tmp_path, epochs=2)
    assert [row["train_loss"] for row in read_metrics(tmp_path)] == [0, 0.5]


def test_gradient_that_is_not_finite_stops_the_training(tmp_path: Path) -> None:
    with pytest.raises(
        StageError, match=r"the gradient's norm is nan \(limit inf\), in epoch 1, step 1; look at the items of its batch: point-"
    ):
        fit(Steep(plain=True), tmp_path)


def test_validation_loss_that_is_not_finite_stops_the_training(tmp_path: Path) -> None:
    with pytest.raises(StageError, match="validation loss of epoch 1 is nan; lower learning_rate"):
        fit(Unmeasured(plain=True), tmp_path)


class Raising(Regression):
    """Raises an error in its validation."""

    def __init__(self, error: Exception) -> None:
        super().__init__(plain=True)
        self.error = error

    def validate(self, network: torch.nn.Module) -> dict[str, float]:
        raise self.error from KeyError("the cause")


@pytest.mark.parametrize(
    "error",
    [StageError("of\n\ntwo lines"), pytest.param(OSError(28, "No space left on device"), marks=pytest.mark.slow)],
    ids=["ours", "full"],
)
def test_error_message_of_one_of_several_processes_is_reported_completely(tmp_path: Path, error: Exception) -> None:
    with pytest.raises(StageError) as raised:
        fit(Raising(error), tmp_path, devices=2)
    assert str(raised.value).removeprefix("OSError: ") == str(error)


@pytest.mark.slow
def test_unexpected_error_in_one_of_several_processes_keeps_its_traceback(tmp_path: Path) -> None:
    with pytest.raises(ProcessRaisedException, match=r"(?s)in validate\n.*ValueError: of\ntwo lines"):
        fit(Raising(ValueError("of\ntwo lines")), tmp_path, devices=2)


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("loss", r"NaN.*, in epoch 1, step 1; look at the items of its batch: point-"),
        ("validation", "the validation of epoch 1 failed: .*NaN"),
    ],
)
def test_error_of_a_kernel_stops_the_training_and_names_the_items(tmp_path: Path, where: str, message: str) -> None:
    with pytest.raises(StageError, match=message):
        fit(Refused(where), tmp_path)
