"""The training loop: one for every network, on whatever device, to the same weights however often it is killed."""

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
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn
from torch.multiprocessing.spawn import ProcessRaisedException

from pipeline.console import Meter, console_on
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError
from pipeline.rng import numpy_rng, torch_generator
from pipeline.store.directory import LOGS
from pipeline.training import checkpoint
from pipeline.training.checkpoint import Progress
from pipeline.training.device import device_of
from pipeline.training.settings import TrainingSettings

if TYPE_CHECKING:  # importing it takes seconds, which a run that is up to date need not spend
    from lightning_fabric import Fabric

METRICS = "metrics.json"


class Learner(Protocol):
    """What is trained, and on what.

    `module` is replaced by Fabric's wrapper of it when training begins, hence the loss calls `self.module`.
    """

    module: nn.Module

    def __len__(self) -> int:
        """Training items an epoch."""

    def loss(self, items: Sequence[int], generator: torch.Generator) -> Tensor:
        """The training loss of some items: a scalar that depends on them, the module and the generator (on the CPU) alone."""

    def validate(self) -> dict[str, float]:
        """Metrics on the validation split, deterministic; "loss" says which epoch is best."""

    def describe(self, item: int) -> str:
        """An item in words, for the message that stops a training."""


def train(learner: Learner, settings: TrainingSettings, job: DatasetJob, name: str) -> dict[str, Any]:
    """Train until the epochs or the patience end; leaves the best epoch's weights in the module.

    A killed training goes on from the checkpoint in the job's folder, to the same weights, to the bit, as one that was not
    (on the same machine). The checkpoint stays until the caller, who has saved the model, discards it. `metrics.json` gets
    the losses of every epoch, `tensorboard` the curves. With the job's seed, `name` keys the order of items and whatever
    is drawn.

    Returns
    -------
    Facts for the record: parameters, epochs, the best one and its metrics, seconds, hardware.

    Raises
    ------
    StageError
        There is nothing to train on; or a loss is no number, is refused by a kernel, or explodes: with epoch, step, and the items
        of the batch.
    """
    from lightning_fabric import Fabric
    from lightning_fabric.loggers.tensorboard import TensorBoardLogger

    if not len(learner):
        raise StageError(f"{name}: there are no items to train on; take more objects, or look at why theirs failed")
    try:
        accelerator = device_of(settings.accelerator).type
        logger = TensorBoardLogger(job.folder, name=LOGS, version="")
        strategy = "ddp_spawn" if settings.devices > 1 else "auto"
        fabric = Fabric(accelerator=accelerator, strategy=strategy, devices=settings.devices, precision=settings.precision, loggers=logger)
    except (RuntimeError, ValueError, ImportError) as error:
        raise StageError(f"accelerator {settings.accelerator}, {settings.devices} devices, {settings.precision}: {error}") from error
    begin: Any = _train  # Fabric's signature leaves out the arguments that it passes on
    before = torch.get_num_threads()
    try:
        facts: dict[str, Any] = fabric.launch(begin, learner, settings, job.folder, job.seed, name)
    except ProcessRaisedException as error:  # what one of several processes raised, as text
        raise StageError(str(error).strip().splitlines()[-1]) from error
    finally:
        torch.set_num_threads(before)
    learner.module.load_state_dict(checkpoint.load_best(job.folder))
    return facts


@dataclass
class _Run:
    """What the parts of a training share."""

    fabric: Fabric
    learner: Learner
    bare: nn.Module
    adam: torch.optim.Optimizer
    optimizer: Any
    settings: TrainingSettings
    folder: Path
    seed: int
    name: str
    progress: Progress
    best: dict[str, Tensor]

    @property
    def steps(self) -> int:
        return math.ceil(len(self.learner) / self.settings.batch_size)

    def save(self) -> None:
        if self.fabric.is_global_zero:
            checkpoint.save(self.folder, self.bare, self.adam, self.best, self.progress)


def _train(fabric: Fabric, learner: Learner, settings: TrainingSettings, folder: Path, seed: int, name: str) -> dict[str, Any]:
    torch.set_num_threads(settings.threads)
    bare = learner.module
    if fabric.world_size > 1:  # spawned processes are handed one memory for its weights: each would step in the others'
        bare = copy.deepcopy(bare)
    adam = torch.optim.Adam(bare.parameters(), lr=settings.learning_rate)
    learner.module, optimizer = fabric.setup(bare, adam)
    best, progress = checkpoint.load(folder, bare, adam)  # now that they are where, and of the type, they are trained with
    run = _Run(fabric, learner, bare, adam, optimizer, settings, folder, seed, name, progress, best)
    began = time.perf_counter() - progress.seconds
    shown = Meter(console_on(sys.stdout), name, settings.epochs * run.steps, "steps", progress.epoch * run.steps + progress.step)
    with shown if fabric.is_global_zero else nullcontext():
        while progress.epoch < settings.epochs and not _out_of_patience(progress, settings):
            _epoch(run, shown, began)
            progress.seconds = time.perf_counter() - began
            run.save()
    learner.module = bare
    if fabric.is_global_zero:
        (folder / METRICS).write_text(json.dumps(progress.history, indent=2, allow_nan=False))
    assert progress.best is not None
    if fabric.world_size > 1:  # else its threads are ended by the process's end, and at times abort it
        torch.distributed.destroy_process_group()
    return {
        "parameters": sum(parameter.numel() for parameter in bare.parameters()),
        "items": len(learner),
        "epochs": progress.epoch,
        "best_epoch": progress.best,
        "best": progress.history[progress.best],
        "training_seconds": round(progress.seconds, 1),
        "hardware": _hardware(fabric, settings.precision),
    }


def _epoch(run: _Run, shown: Meter, began: float) -> None:
    """Do what is left of an epoch, then validate."""
    progress, settings = run.progress, run.settings
    order = numpy_rng(run.seed, run.name, "order", progress.epoch).permutation(len(run.learner))
    batches = [order[start : start + settings.batch_size] for start in range(0, len(order), settings.batch_size)]
    run.learner.module.train()
    saved = time.perf_counter()
    while progress.step < len(batches):
        loss = _step(run, batches[progress.step])
        progress.sums += loss
        progress.step += 1
        note = f"epoch {progress.epoch + 1}, loss {progress.sums / progress.step:.4g}"
        if run.fabric.is_global_zero:
            shown.advance(note)
        if time.perf_counter() - saved > settings.checkpoint_seconds:
            progress.seconds = time.perf_counter() - began
            run.save()
            saved = time.perf_counter()
    run.learner.module.eval()
    try:
        with torch.no_grad():
            metrics = run.learner.validate()
    except ValueError as error:
        raise StageError(f"{run.name}: the validation of epoch {progress.epoch + 1} failed: {error}") from error
    row = {"train_loss": progress.sums / len(batches), **metrics}
    if not math.isfinite(row["loss"]):
        raise StageError(f"{run.name}: the validation loss of epoch {progress.epoch + 1} is {row['loss']}; lower learning_rate")
    run.fabric.log_dict(row, step=progress.epoch)
    if progress.best is None or row["loss"] < progress.history[progress.best]["loss"]:
        progress.best = progress.epoch
        run.best = {name: value.detach().cpu().clone() for name, value in run.bare.state_dict().items()}
    progress.history.append(row)
    progress.epoch, progress.step, progress.sums = progress.epoch + 1, 0, 0.0


def _step(run: _Run, batch: np.ndarray) -> float:
    """One step of Adam on this process's part of a batch; the loss."""
    fabric, progress = run.fabric, run.progress
    mine = batch[fabric.global_rank :: fabric.world_size]
    items = [int(item) for item in (mine if len(mine) else batch[:1])]
    generator = torch_generator(run.seed, run.name, progress.epoch, progress.step, fabric.global_rank)
    run.optimizer.zero_grad()
    try:
        loss = run.learner.loss(items, generator)
    except ValueError as error:
        raise StageError(f"{run.name}: {error}; in epoch {progress.epoch + 1}, step {progress.step + 1}, {_named(run, items)}") from error
    value = float(loss.detach())
    _refuse(run, items, value, "loss")
    fabric.backward(loss)
    gradients = [parameter.grad for parameter in run.bare.parameters() if parameter.grad is not None]
    _refuse(run, items, float(torch.nn.utils.get_total_norm(gradients)), "gradient's norm")
    run.optimizer.step()
    if fabric.world_size == 1:
        return value
    mean: Any = fabric.all_reduce(torch.tensor(value, device=fabric.device))
    return float(mean)


def _refuse(run: _Run, items: Sequence[int], value: float, what: str) -> None:
    """Stop at a value that no later step mends, and say which items gave it."""
    progress = run.progress
    first = abs(progress.history[0]["train_loss"]) if progress.history else 0.0
    limit = run.settings.explosion * first if first and what == "loss" else math.inf  # nothing is a multiple of 0
    if math.isfinite(value) and abs(value) <= limit:
        return
    raise StageError(
        f"{run.name}: the {what} is {value:g} in epoch {progress.epoch + 1}, step {progress.step + 1} (limit {limit:g}); "
        f"{_named(run, items)}. Lower learning_rate ({run.settings.learning_rate:g}), or look at these items"
    )


def _named(run: _Run, items: Sequence[int]) -> str:
    return f"its batch: {', '.join(run.learner.describe(item) for item in items)}"


def _out_of_patience(progress: Progress, settings: TrainingSettings) -> bool:
    return settings.patience is not None and progress.best is not None and progress.epoch - 1 - progress.best >= settings.patience


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
    """The losses of every epoch of a finished training."""
    rows: list[dict[str, float]] = json.loads((folder / METRICS).read_text())
    return rows
