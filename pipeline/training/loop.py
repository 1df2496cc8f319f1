"""The training loop of every network and device: it ends with the same weights, however often it is killed."""

import json
import math
import platform
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import torch
from torch import distributed
from torch.nn.parallel import DistributedDataParallel
from torch.utils.tensorboard import SummaryWriter

from pipeline.console import Meter, console_on, pluralise
from pipeline.errors import InvalidInput, StageError
from pipeline.models.device import device_of, torch_threads
from pipeline.rng import numpy_rng, torch_generator
from pipeline.store.digest import LOGS
from pipeline.store.record import processor, processor_kind
from pipeline.training import checkpoint
from pipeline.training.learner import Learner
from pipeline.training.processes import run_processes, share_batch_norm
from pipeline.training.settings import TrainingSettings

T = TypeVar("T")
R = TypeVar("R")

MAX_LOSS_GROWTH = 1e4
"""A loss above the first epoch's mean by this factor stops the training: no later epoch recovers from it."""


def train(
    learner: Learner,
    settings: TrainingSettings,
    *,
    folder: Path,  # gets the checkpoint, `metrics.json` (losses per epoch), and the curves in `tensorboard`
    seed: int,  # with `name`, keys the order of items and all random draws
    name: str,
) -> dict[str, Any]:  # parameters, epochs, the best one and its metrics, seconds, hardware
    """Train until the epochs or the patience end; leave the best epoch's weights in the learner's network.

    A killed training continues from the checkpoint in the folder and ends, on the same machine, with the same weights,
    to the bit, as an uninterrupted one. The checkpoint stays: the caller that publishes the model removes it.
    """
    if not len(learner.train):
        raise StageError(f"{name}: there are no items to train on; take more objects, or see `vt-pipeline status` for those that failed")
    device = device_of(settings.accelerator)
    gpus = torch.cuda.device_count() if device.type == "cuda" else 0
    if gpus and settings.devices > gpus:
        raise StageError(f"devices is {settings.devices}, this machine has {pluralise(gpus, 'GPU')}; lower it, or set accelerator=cpu")
    arguments = learner, settings, folder, seed, name
    if settings.devices == 1:
        _train(device, *arguments)
    else:
        run_processes(name, settings.devices, device, _train, *arguments)
    best, progress = checkpoint.load_best(folder)
    learner.network.load_state_dict(best)
    return {
        "parameters": sum(parameter.numel() for parameter in learner.network.parameters()),
        "items": len(learner.train),
        "epochs": progress.epoch,
        "best_epoch": progress.best,
        "best": progress.history[progress.best],
        "training_seconds": round(progress.seconds, 1),
        "hardware": {
            "device": torch.cuda.get_device_name(device) if gpus else f"{platform.machine()} CPU",
            "processes": settings.devices,
            "processor": processor_kind(processor()),
            "threads": settings.threads,
            "precision": settings.precision,
        },
    }


def _train(device: torch.device, learner: Learner, settings: TrainingSettings, folder: Path, seed: int, name: str) -> None:
    with torch_threads(settings.threads):
        _Training(device, learner, settings, folder, seed, name).run()


class Part(NamedTuple):
    """The part of a batch that one process learns from."""

    items: list[int]
    share: float  # of the batch; 0 for placeholders


class _Training:
    """A training in this process, which may be one of several. `network` may wrap `module`, the bare network."""

    def __init__(self, device: torch.device, learner: Learner, settings: TrainingSettings, folder: Path, seed: int, name: str) -> None:
        self.learner, self.settings, self.folder, self.seed, self.name = learner, settings, folder, seed, name
        self.rank, self.processes = (distributed.get_rank(), settings.devices) if settings.devices > 1 else (0, 1)
        self.norms = share_batch_norm(learner.network) if self.processes > 1 else []
        self.module = learner.network.to(device, torch.float64 if settings.precision == "64-true" else torch.float32)
        self.network = DistributedDataParallel(self.module) if self.processes > 1 else self.module
        self.autocast = partial(torch.autocast, device.type, torch.bfloat16, enabled=settings.precision == "bf16-mixed")
        self.adam = torch.optim.Adam(self.module.parameters(), lr=settings.learning_rate, fused=True)
        self.best, self.progress = checkpoint.load(folder, self.module, self.adam)
        self.began = time.perf_counter() - self.progress.seconds
        self.steps = math.ceil(len(learner.train) / settings.batch_size)  # of an epoch

    def run(self) -> None:
        """Train to the end of the epochs or of the patience."""
        settings, progress = self.settings, self.progress
        steps_done = progress.epoch * self.steps + progress.step
        meter = Meter(console_on(sys.stdout), self.name, settings.epochs * self.steps, "steps", steps_done)
        curves: Any = SummaryWriter(self.folder / LOGS) if self.rank == 0 else nullcontext()
        with meter if self.rank == 0 else nullcontext(), curves:
            while progress.epoch < min(settings.epochs, progress.best + 1 + (settings.patience or math.inf)):
                self.train_epoch(meter)
                row = self.validate_epoch()
                for metric, value in row.items() if self.rank == 0 else ():
                    curves.add_scalar(metric, value, progress.epoch - 1)
                self.save()
        if self.rank == 0:
            (self.folder / checkpoint.METRICS).write_text(json.dumps(progress.history, indent=2, allow_nan=False))

    def train_epoch(self, meter: Meter) -> None:
        """Take the remaining steps of an epoch."""
        progress, size = self.progress, self.settings.batch_size
        order = numpy_rng(self.seed, self.name, "order", progress.epoch).permutation(len(self.learner.train))
        parts = (self.part(order[start:][:size].tolist()) for start in range(progress.step * size, len(order), size))
        self.network.train()
        saved = time.perf_counter()
        for part, content in read_ahead(self.read, parts):
            progress.sums += self.step(part, content)
            progress.step += 1
            if self.rank == 0:
                meter.advance(f"epoch {progress.epoch + 1}, loss {progress.sums / progress.step:.4g}")
            if time.perf_counter() - saved > self.settings.checkpoint_seconds:
                self.save()
                saved = time.perf_counter()

    def part(self, batch: list[int]) -> Part:
        """Take this process's part of a batch; with fewer items than processes, it may be an item that does not count."""
        items = batch[self.rank :: self.processes]
        return Part(items or batch[:1], len(items) / len(batch))

    def read(self, part: Part) -> Any:
        """Read the items of a part; random draws are keyed by the item, hence the same in every process."""
        generators = [torch_generator(self.seed, self.name, self.progress.epoch, item) for item in part.items]
        return self.learner.read(part.items, generators)

    def step(self, part: Part, content: Callable[[], Any]) -> float:
        """Take one step of Adam on this process's part of a batch; return the loss of the whole batch."""
        progress, items = self.progress, part.items
        for batch_norm in self.norms:
            batch_norm.share = float(part.share > 0)
        self.adam.zero_grad()
        try:
            with self.autocast():
                loss = self.learner.loss(self.network, content())
        except InvalidInput as error:
            raise self.failure(str(error), items) from error
        first_loss = abs(progress.history[0]["train_loss"]) if progress.history else 0.0
        self.check_size(items, "loss", float(loss.detach()), limit=MAX_LOSS_GROWTH * first_loss or math.inf)  # nothing is a multiple of 0
        weighted: Any = part.share * self.processes * loss  # its mean over the processes is the batch's mean
        weighted.backward()
        gradients = [parameter.grad for parameter in self.module.parameters() if parameter.grad is not None]
        norm = torch.nn.utils.get_total_norm(gradients)
        self.check_size(items, "gradient's norm", float(norm), limit=math.inf)
        if self.settings.gradient_limit is not None:
            torch.nn.utils.clip_grads_with_norm_(self.module.parameters(), self.settings.gradient_limit, norm)
        rate = self.settings.rate_at(progress.epoch * self.steps + progress.step, self.settings.epochs * self.steps)
        for group in self.adam.param_groups:
            group["lr"] = rate
        self.adam.step()
        total = weighted.detach()
        if self.processes > 1:
            distributed.all_reduce(total)
        return float(total) / self.processes

    def check_size(self, items: Sequence[int], name: str, value: float, *, limit: float) -> None:
        """Stop the training at a value from which no later step recovers."""
        if not math.isfinite(value) or abs(value) > limit:
            raise self.failure(f"the {name} is {value:g} (limit {limit:g})", items)

    def failure(self, reason: str, items: Sequence[int]) -> StageError:
        """Make the error that names the step and the items."""
        step = f"in epoch {self.progress.epoch + 1}, step {self.progress.step + 1}"
        learned = self.progress.epoch or self.progress.step  # at the first step the rate is not the cause
        advice = (f"lower learning_rate ({self.settings.learning_rate:g}), or " if learned else "") + "look at the items of its batch"
        return StageError(f"{self.name}: {reason}, {step}; {advice}: {', '.join(map(self.learner.train.name, items))}")

    def validate_epoch(self) -> dict[str, float]:
        """Compute the metrics of the weights; keep these if they are the best so far, and go to the next epoch."""
        progress = self.progress
        self.network.eval()
        try:
            with torch.no_grad(), self.autocast():
                metrics = self.learner.validate(self.network)
        except InvalidInput as error:
            raise StageError(f"{self.name}: the validation of epoch {progress.epoch + 1} failed: {error}") from error
        row = {"train_loss": progress.sums / self.steps, **metrics}
        if not math.isfinite(row["loss"]):
            raise StageError(f"{self.name}: the validation loss of epoch {progress.epoch + 1} is {row['loss']}; lower learning_rate")
        if not progress.history or self.learner.keeps_last or row["loss"] < progress.history[progress.best]["loss"]:
            progress.best = progress.epoch
            self.best = {name: value.detach().cpu().clone() for name, value in self.module.state_dict().items()}
        progress.history.append(row)
        progress.epoch, progress.step, progress.sums = progress.epoch + 1, 0, 0.0
        return row

    def save(self) -> None:
        """Write the checkpoint."""
        self.progress.seconds = time.perf_counter() - self.began
        if self.rank == 0:
            checkpoint.save(self.folder, self.module, self.adam, self.best, self.progress)


def read_ahead(read: Callable[[T], R], parts: Iterable[T]) -> Iterator[tuple[T, Callable[[], R]]]:
    """Yield each part with a function that waits for its content, or raises the error of reading it.

    A thread reads the next part meanwhile; at most two are held.
    """
    with ThreadPoolExecutor(1, "read") as reader:
        submitted = ((part, reader.submit(read, part)) for part in parts)
        current = next(submitted, None)
        while current:
            part, future = current
            current = next(submitted, None)
            yield part, future.result
