"""The training loop of every network and device: it ends with the same weights, however often it is killed."""

import copy
import json
import math
import platform
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import torch
from lightning_fabric import Fabric
from torch.multiprocessing.spawn import ProcessExitedException, ProcessRaisedException

from pipeline.console import Meter, console_on
from pipeline.errors import InvalidInput, StageError
from pipeline.rng import numpy_rng, torch_generator
from pipeline.store.record import processor, processor_kind
from pipeline.training import checkpoint
from pipeline.training.batch_norm import share_batch_norm
from pipeline.training.device import torch_threads
from pipeline.training.learner import Learner
from pipeline.training.processes import (
    RESUME_HINT,
    end_children_on_interrupt,
    end_with_parent,
    lost_peers_as_stage_error,
    make_fabric,
)
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

    A fault of ours in one of several processes is a `ProcessRaisedException` with its traceback.
    """
    if not len(learner):
        raise StageError(f"{name}: there are no items to train on; take more objects, or see `vt-pipeline status` for those that failed")
    fabric = make_fabric(settings, folder)
    begin: Any = _begin  # Fabric's signature leaves out the arguments that it passes on
    try:
        with end_children_on_interrupt():
            facts: dict[str, Any] = fabric.launch(begin, learner, settings, folder=folder, seed=seed, name=name)
    except ProcessRaisedException as error:  # the error of one of several processes, as text
        if (message := _message_of(str(error))) is None:
            raise
        raise StageError(message) from error
    except ProcessExitedException as error:
        ended = f"was ended by {error.signal_name}" if error.signal_name else f"ended with status {error.exit_code}"
        raise StageError(f"{name}: process {error.error_index} of {settings.devices} {ended}; {RESUME_HINT}") from error
    learner.network.load_state_dict(checkpoint.load_best(folder))
    return facts


def _message_of(traceback: str) -> str | None:
    """Find the message of an error that the user can fix, the project's or the system's, in the traceback of another process."""
    last_error = traceback.rpartition("Traceback (most recent call last):")[2]  # of errors that were raised from others
    match = re.search(r"^(?:pipeline\.errors\.\w+: |(?=\w+Error: \[Errno ))(.+)", last_error.rstrip(), re.MULTILINE | re.DOTALL)
    return match and match[1]


def _begin(fabric: Fabric, learner: Learner, settings: TrainingSettings, *, folder: Path, seed: int, name: str) -> dict[str, Any]:
    end_with_parent()
    with torch_threads(settings.threads), lost_peers_as_stage_error(fabric, name):
        return _Training(fabric, learner, settings, folder=folder, seed=seed, name=name).run()


class Part(NamedTuple):
    """The part of a batch that one process learns from."""

    items: list[int]
    share: float  # of the batch; 0 for placeholders


class _Training:
    """A training in this process, which may be one of several. `network` wraps `module`, the bare network, for device and processes."""

    def __init__(self, fabric: Fabric, learner: Learner, settings: TrainingSettings, *, folder: Path, seed: int, name: str) -> None:
        self.fabric, self.learner, self.settings, self.folder, self.seed, self.name = fabric, learner, settings, folder, seed, name
        # spawned processes share the memory of a network's weights: each would step in the others'
        self.module = copy.deepcopy(learner.network) if fabric.world_size > 1 else learner.network
        self.norms = share_batch_norm(self.module) if fabric.world_size > 1 else []
        self.adam = torch.optim.Adam(self.module.parameters(), lr=settings.learning_rate)
        wrapped: Any = fabric.setup(self.module, self.adam)
        self.network, self.optimizer = wrapped
        self.best, self.progress = checkpoint.load(folder, self.module, self.adam)  # now that they have their type and device
        self.began = time.perf_counter() - self.progress.seconds
        self.steps = math.ceil(len(learner) / settings.batch_size)  # of an epoch

    def run(self) -> dict[str, Any]:
        """Train to the end of the epochs or of the patience; return the facts."""
        fabric, settings, progress = self.fabric, self.settings, self.progress
        steps_done = progress.epoch * self.steps + progress.step
        meter = Meter(console_on(sys.stdout), self.name, settings.epochs * self.steps, "steps", steps_done)
        with meter if fabric.is_global_zero else nullcontext():
            while progress.epoch < min(settings.epochs, progress.best + 1 + (settings.patience or math.inf)):
                self.train_epoch(meter)
                self.validate_epoch()
                self.save()
        if fabric.is_global_zero:
            (self.folder / checkpoint.METRICS).write_text(json.dumps(progress.history, indent=2, allow_nan=False))
        del self.network  # its reducer must not be the last to hold the process group, whose destructor would then deadlock
        if fabric.world_size > 1:  # otherwise its threads end with the process, and sometimes abort it
            torch.distributed.destroy_process_group()
        gpu = fabric.device.type == "cuda"
        return {
            "parameters": sum(parameter.numel() for parameter in self.module.parameters()),
            "items": len(self.learner),
            "epochs": progress.epoch,
            "best_epoch": progress.best,
            "best": progress.history[progress.best],
            "training_seconds": round(progress.seconds, 1),
            "hardware": {
                "device": torch.cuda.get_device_name(fabric.device) if gpu else f"{platform.machine()} CPU",
                "processes": fabric.world_size,
                "processors": [processor_kind(processor())],
                "threads": torch.get_num_threads(),
                "precision": settings.precision,
            },
        }

    def train_epoch(self, meter: Meter) -> None:
        """Take the remaining steps of an epoch."""
        progress, size = self.progress, self.settings.batch_size
        order = numpy_rng(self.seed, self.name, "order", progress.epoch).permutation(len(self.learner))
        parts = (self.part(order[start:][:size].tolist()) for start in range(progress.step * size, len(order), size))
        self.network.train()
        saved = time.perf_counter()
        for part, content in read_ahead(self.read, parts):
            progress.sums += self.step(part, content)
            progress.step += 1
            if self.fabric.is_global_zero:
                meter.advance(f"epoch {progress.epoch + 1}, loss {progress.sums / progress.step:.4g}")
            if time.perf_counter() - saved > self.settings.checkpoint_seconds:
                self.save()
                saved = time.perf_counter()

    def part(self, batch: list[int]) -> Part:
        """Take this process's part of a batch; with fewer items than processes, it may be an item that does not count."""
        items = batch[self.fabric.global_rank :: self.fabric.world_size]
        return Part(items or batch[:1], len(items) / len(batch))

    def read(self, part: Part) -> Any:
        """Read the items of a part; random draws are keyed by the item, hence the same in every process."""
        generators = [torch_generator(self.seed, self.name, self.progress.epoch, item) for item in part.items]
        return self.learner.read(part.items, generators)

    def step(self, part: Part, content: Callable[[], Any]) -> float:
        """Take one step of Adam on this process's part of a batch; return the loss of the whole batch."""
        fabric, progress, items = self.fabric, self.progress, part.items
        for batch_norm in self.norms:
            batch_norm.share = float(part.share > 0)
        self.optimizer.zero_grad()
        try:
            loss = self.learner.loss(self.network, content())
        except InvalidInput as error:
            raise self.failure(str(error), items) from error
        first_loss = abs(progress.history[0]["train_loss"]) if progress.history else 0.0
        self.check_size(items, "loss", float(loss.detach()), limit=MAX_LOSS_GROWTH * first_loss or math.inf)  # nothing is a multiple of 0
        weighted = part.share * fabric.world_size * loss  # its mean over the processes is the batch's mean
        fabric.backward(weighted)
        gradients = [parameter.grad for parameter in self.module.parameters() if parameter.grad is not None]
        norm = torch.nn.utils.get_total_norm(gradients)
        self.check_size(items, "gradient's norm", float(norm), limit=math.inf)
        if self.settings.gradient_limit is not None:
            torch.nn.utils.clip_grads_with_norm_(self.module.parameters(), self.settings.gradient_limit, norm)
        rate = self.settings.rate_at(progress.epoch * self.steps + progress.step, self.settings.epochs * self.steps)
        for group in self.adam.param_groups:
            group["lr"] = rate
        self.optimizer.step()
        mean: Any = fabric.all_reduce(weighted.detach())
        return float(mean)

    def check_size(self, items: Sequence[int], name: str, value: float, *, limit: float) -> None:
        """Stop the training at a value from which no later step recovers."""
        if not math.isfinite(value) or abs(value) > limit:
            raise self.failure(f"the {name} is {value:g} (limit {limit:g})", items)

    def failure(self, reason: str, items: Sequence[int]) -> StageError:
        """Make the error that names the step and the items."""
        step = f"in epoch {self.progress.epoch + 1}, step {self.progress.step + 1}"
        learned = self.progress.epoch or self.progress.step  # at the first step the rate is not the cause
        advice = (f"lower learning_rate ({self.settings.learning_rate:g}), or " if learned else "") + "look at the items of its batch"
        return StageError(f"{self.name}: {reason}, {step}; {advice}: {', '.join(map(self.learner.describe, items))}")

    def validate_epoch(self) -> None:
        """Compute the metrics of the weights; keep them if they are the best so far, and go to the next epoch."""
        progress = self.progress
        self.network.eval()
        try:
            with torch.no_grad():
                metrics = self.learner.validate(self.network)
        except InvalidInput as error:
            raise StageError(f"{self.name}: the validation of epoch {progress.epoch + 1} failed: {error}") from error
        row = {"train_loss": progress.sums / self.steps, **metrics}
        if not math.isfinite(row["loss"]):
            raise StageError(f"{self.name}: the validation loss of epoch {progress.epoch + 1} is {row['loss']}; lower learning_rate")
        self.fabric.log_dict(row, step=progress.epoch)
        if not progress.history or self.learner.keeps_last or row["loss"] < progress.history[progress.best]["loss"]:
            progress.best = progress.epoch
            self.best = {name: value.detach().cpu().clone() for name, value in self.module.state_dict().items()}
        progress.history.append(row)
        progress.epoch, progress.step, progress.sums = progress.epoch + 1, 0, 0.0

    def save(self) -> None:
        """Write the checkpoint."""
        self.progress.seconds = time.perf_counter() - self.began
        if self.fabric.is_global_zero:
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
