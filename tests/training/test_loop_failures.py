"""Trainings that stop with an error: losses from which no later step recovers, kernels and readers that fail."""

import math
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from pipeline.errors import StageError, StoreError
from pipeline.kernels.metrics.chamfer import chamfer
from pipeline.models.device import torch_threads
from pipeline.training.checkpoint import read_metrics
from tests.training.regression import Batch, Regression, Scripted, fit, settings


class Perfect(Regression):
    """Starts where its loss is 0 and stays so for an epoch; then it is `later`."""

    def __init__(self, later: float) -> None:
        super().__init__(plain=True)
        self.later = later

    def loss(self, network: torch.nn.Module, batch: Batch) -> torch.Tensor:
        nothing = 0 * super().loss(network, batch)
        return nothing + (self.later if self.steps > len(self.train) / settings().batch_size else 0)


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


class Unreadable(Regression):
    """An item's chunk is damaged."""

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        if 17 in items:
            raise StoreError("readings of point-17 cannot be read")
        return super().read(items, generators)


class Few(Regression):
    """Learner with a set number of items."""

    def __init__(self, count: int) -> None:
        super().__init__(plain=True)
        del self.train[count:]


class Raising(Regression):
    """Raises an error in its validation."""

    def __init__(self, error: Exception) -> None:
        super().__init__(plain=True)
        self.error = error

    def validate(self, network: torch.nn.Module) -> dict[str, float]:
        raise self.error from KeyError("the cause")


@pytest.mark.parametrize(
    ("learner", "changes", "error", "message"),
    [
        (Few(0), {}, StageError, "there are no items to train on"),
        (Regression(poison=17), {}, StageError, r"loss is nan .*, in epoch 1, step \d; lower learning_rate .* its batch: .*point-17\b"),
        (Scripted([1.0, 10001.0]), {}, StageError, r"loss is 10001 \(limit 10000\), in epoch 2, step 1; lower .* its batch: point-"),
        (Scripted(validation=[math.nan]), {}, StageError, "validation loss of epoch 1 is nan"),
        (Steep(plain=True), {}, StageError, r"gradient's norm is nan \(limit inf\), in epoch 1, step 1; look at the items of its batch"),
        (Refused("loss"), {}, StageError, r"NaN.*, in epoch 1, step 1; look at the items of its batch: point-"),
        (Refused("validation"), {}, StageError, "the validation of epoch 1 failed: .*NaN"),
        (Unreadable(), {}, StoreError, "readings of point-17 cannot be read"),
        pytest.param(Regression(poison=17), {"devices": 2}, StageError, r"loss is nan .* in epoch 1.*point-", marks=pytest.mark.slow),
    ],
)
def test_training_stops_and_names_the_reason(
    tmp_path: Path, learner: Regression, changes: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        fit(learner, tmp_path, **changes)


def test_missing_device_is_an_error(tmp_path: Path) -> None:
    if torch.cuda.is_available():
        pytest.skip("there is one")
    with pytest.raises(StageError, match="accelerator cuda"):
        fit(Regression(), tmp_path, accelerator="cuda")


def test_training_on_one_item_works(tmp_path: Path) -> None:
    facts = fit(Few(1), tmp_path, epochs=2)
    assert (facts["items"], facts["epochs"]) == (1, 2)


def test_finite_loss_after_an_epoch_of_zero_loss_is_accepted(tmp_path: Path) -> None:
    fit(Perfect(later=0.5), tmp_path, epochs=2)
    assert [row["train_loss"] for row in read_metrics(tmp_path)] == [0, 0.5]


@pytest.mark.slow
@pytest.mark.parametrize("error", [StageError("of\n\ntwo lines"), OSError(28, "No space left on device")], ids=["ours", "full"])
def test_error_message_of_one_of_several_processes_is_reported_completely(tmp_path: Path, error: Exception) -> None:
    with pytest.raises(type(error)) as raised:
        fit(Raising(error), tmp_path, devices=2)
    assert str(raised.value) == str(error)


@pytest.mark.slow
def test_unexpected_error_in_one_of_several_processes_keeps_its_traceback(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="of\ntwo lines") as raised:
        fit(Raising(ValueError("of\ntwo lines")), tmp_path, devices=2)
    assert "in validate\n" in str(raised.value.__cause__)


def test_number_of_threads_is_restored_after_an_error() -> None:
    before, inside = torch.get_num_threads(), []
    with suppress(ZeroDivisionError), torch_threads(before + 1):
        inside.append(torch.get_num_threads())
        raise ZeroDivisionError
    assert inside == [before + 1]
    assert torch.get_num_threads() == before
