"""The training loop: one for each network, on whatever device, to the same weights however often it is killed."""

from __future__ import annotations

import copy
import json
import math
import platform
import sys
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.multiprocessing.spawn import ProcessRaisedException

from pipeline.console import Meter, console_on
from pipeline.errors import InvalidInput, StageError
from pipeline.rng import numpy_rng, torch_generator
from pipeline.store.directory import LOGS
from pipeline.training import checkpoint
from pipeline.training.checkpoint import Progress
from pipeline.training.device import device_of
from pipeline.training.learner import Learner
from pipeline.training.settings import TrainingSettings

if TYPE_CHECKING:  # importing it takes seconds, which a run that is up to date need not spend
    from lightning_fabric import Fabric

METRICS = "metrics.json"


def train(learner: Learner, settings: TrainingSettings, *, folder: Path, seed: int, name: str) -> dict[str, Any]:
    """Train until the epochs or the patience end; leaves the best epoch's weights in the module.

    A killed training continues from the checkpoint in the folder, to the same weights, to the bit, as one that was not (on the same
    machine). The checkpoint stays until the caller, who has saved the model, discards it.

    Parameters
    ----------
    learner
        What is trained.
    settings
        How.
    folder
        Gets the checkpoint, `metrics.json` with the losses of each epoch, and the curves in `tensorboard`.
    seed, name
        Key the order of items and whatever is drawn.

    Returns
    -------
    Facts for the record: parameters, epochs, the best one and its metrics, seconds, hardware.

    Raises
    ------
    StageError
        There is nothing to train on; or a loss is no number, is refused by a kernel, or explodes: with epoch, step, and the items of the
        batch.
    """
    from lightning_fabric import Fabric
    from lightning_fabric.loggers.tensorboard import TensorBoardLogger

    if not len(learner):
        raise StageError(f"{name}: there are no items to train on; take more objects, or look at why theirs failed")
    try:
        accelerator = device_of(settings.accelerator).type
        logger = TensorBoardLogger(folder, name=LOGS, version="")
        strategy = "ddp_spawn" if settings.devices > 1 else "auto"
        fabric = Fabric(accelerator=accelerator, strategy=strategy, devices=settings.devices, precision=settings.precision, loggers=logger)
    except (RuntimeError, ValueError, ImportError) as error:
        raise StageError(f"accelerator {settings.accelerator}, {settings.devices} devices, {settings.precision}: {error}") from error
    begin: Any = _train  # Fabric's signature leaves out the arguments that it passes on
    threads = torch.get_num_threads()
    try:
        facts: dict[str, Any] = fabric.launch(begin, learner, settings, folder, seed, name)
    except ProcessRaisedException as error:  # what one of several processes raised, as text
        raise StageError(str(error).strip().splitlines()[-1]) from error
    finally:
        torch.set_num_threads(threads)
    learner.module.load_state_dict(checkpoint.load_best(folder))
    return facts


@dataclass
class _Training:
    """What the parts of a training share. `module` is the network that `learner.module` wraps."""

    fabric: Fabric
    learner: Learner
    module: nn.Module
    adam: torch.optim.Optimizer
    optimizer: Any
    settings: TrainingSettings
    folder: Path
    seed: int
    name: str
    progress: Progress
    best: dict[str, Tensor]
    began: float

    @property
    def steps(self) -> int:
        """Steps of an epoch."""
        return math.ceil(len(self.learner) / self.settings.batch_size)

    def out_of_patience(self) -> bool:
        patience, best = self.settings.patience, self.progress.best
        return patience is not None and best is not None and self.progress.epoch - 1 - best >= patience

    def save(self) -> None:
        self.progress.seconds = time.perf_counter() - self.began
        if self.fabric.is_global_zero:
            checkpoint.save(self.folder, self.module, self.adam, self.best, self.progress)

    def failure(self, reason: str, items: Sequence[int]) -> StageError:
        """An error that says in which step, and with which items."""
        batch = ", ".join(self.learner.describe(item) for item in items)
        return StageError(f"{self.name}: {reason} in epoch {self.progress.epoch + 1}, step {self.progress.step + 1}; its batch: {batch}")


def _train(fabric: Fabric, learner: Learner, settings: TrainingSettings, folder: Path, seed: int, name: str) -> dict[str, Any]:
    """Train in this process, which may be one of several."""
    torch.set_num_threads(settings.threads)
    module = learner.module
    if fabric.world_size > 1:  # spawned processes share the memory of its weights: each would step in the others'
        module = copy.deepcopy(module)
    adam = torch.optim.Adam(module.parameters(), lr=settings.learning_rate)
    learner.module, optimizer = fabric.setup(module, adam)
    best, progress = checkpoint.load(folder, module, adam)  # now that they have the device and type they are trained with
    began = time.perf_counter() - progress.seconds
    training = _Training(fabric, learner, module, adam, optimizer, settings, folder, seed, name, progress, best, began)
    steps = training.steps
    meter = Meter(console_on(sys.stdout), name, settings.epochs * steps, "steps", progress.epoch * steps + progress.step)
    with meter if fabric.is_global_zero else nullcontext():
        while progress.epoch < settings.epochs and not training.out_of_patience():
            _learn(training, meter)
            _validate(training)
            training.save()
    learner.module = module
    if fabric.is_global_zero:
        (folder / METRICS).write_text(json.dumps(progress.history, indent=2, allow_nan=False))
    if fabric.world_size > 1:  # else its threads are ended by the process's end, and at times abort it
        torch.distributed.destroy_process_group()
    assert progress.best is not None
    return {
        "parameters": sum(parameter.numel() for parameter in module.parameters()),
        "items": len(learner),
        "epochs": progress.epoch,
        "best_epoch": progress.best,
        "best": progress.history[progress.best],
        "training_seconds": round(progress.seconds, 1),
        "hardware": _hardware(fabric, settings.precision),
    }


def _learn(training: _Training, meter: Meter) -> None:
    """Take the steps that are left of an epoch."""
    progress, settings = training.progress, training.settings
    order = numpy_rng(training.seed, training.name, "order", progress.epoch).permutation(len(training.learner))
    training.learner.module.train()
    saved = time.perf_counter()
    while progress.step < training.steps:
        first = progress.step * settings.batch_size
        progress.sums += _step(training, order[first : first + settings.batch_size])
        progress.step += 1
        if training.fabric.is_global_zero:
            meter.advance(f"epoch {progress.epoch + 1}, loss {progress.sums / progress.step:.4g}")
        if time.perf_counter() - saved > settings.checkpoint_seconds:
            training.save()
            saved = time.perf_counter()


def _step(training: _Training, batch: NDArray[np.int64]) -> float:
    """Take one step of Adam on this process's part of a batch; the loss of the whole batch."""
    fabric, progress = training.fabric, training.progress
    own = batch[fabric.global_rank :: fabric.world_size]
    items = [int(item) for item in (own if len(own) else batch[:1])]
    generator = torch_generator(training.seed, training.name, progress.epoch, progress.step, fabric.global_rank)
    training.optimizer.zero_grad()
    try:
        loss = training.learner.loss(items, generator)
    except InvalidInput as error:
        raise training.failure(f"{error};", items) from error
    value = float(loss.detach())
    before = abs(progress.history[0]["train_loss"]) if progress.history else 0.0
    _check_size(training, items, "loss", value, limit=training.settings.explosion * before or math.inf)  # nothing is a multiple of 0
    fabric.backward(loss)
    gradients = [parameter.grad for parameter in training.module.parameters() if parameter.grad is not None]
    _check_size(training, items, "gradient's norm", float(torch.nn.utils.get_total_norm(gradients)), limit=math.inf)
    training.optimizer.step()
    if fabric.world_size == 1:
        return value
    mean: Any = fabric.all_reduce(torch.tensor(value, device=fabric.device))
    return float(mean)


def _check_size(training: _Training, items: Sequence[int], what: str, value: float, *, limit: float) -> None:
    """Stop at a value that no later step mends."""
    if not math.isfinite(value) or abs(value) > limit:
        rate = training.settings.learning_rate
        advice = f"lower learning_rate ({rate:g}), or look at the items of its batch"
        raise training.failure(f"the {what} is {value:g} (limit {limit:g}; {advice})", items)


def _validate(training: _Training) -> None:
    """Validate, keep the weights if they are the best so far, and go to the next epoch."""
    progress, name = training.progress, training.name
    training.learner.module.eval()
    try:
        with torch.no_grad():
            metrics = training.learner.validate()
    except InvalidInput as error:
        raise StageError(f"{name}: the validation of epoch {progress.epoch + 1} failed: {error}") from error
    row = {"train_loss": progress.sums / training.steps, **metrics}
    if not math.isfinite(row["loss"]):
        raise StageError(f"{name}: the validation loss of epoch {progress.epoch + 1} is {row['loss']}; lower learning_rate")
    training.fabric.log_dict(row, step=progress.epoch)
    if progress.best is None or row["loss"] < progress.history[progress.best]["loss"]:
        progress.best = progress.epoch
        training.best = {name: value.detach().cpu().clone() for name, value in training.module.state_dict().items()}
    progress.history.append(row)
    progress.epoch, progress.step, progress.sums = progress.epoch + 1, 0, 0.0


def _hardware(fabric: Fabric, precision: str) -> dict[str, Any]:
    """What trained: seconds mean nothing without it."""
    gpu = fabric.device.type == "cuda"
    return {
        "device": torch.cuda.get_device_name(fabric.device) if gpu else f"{platform.machine()} CPU",
        "processes": fabric.world_size,
        "threads": torch.get_num_threads(),
        "precision": precision,
    }


def read_metrics(folder: Path) -> list[dict[str, float]]:
    """Read the losses of each epoch of a finished training."""
    rows: list[dict[str, float]] = json.loads((folder / METRICS).read_text())
    return rows
