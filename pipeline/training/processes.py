"""The processes of this machine that share a training: they start, normalise batches and end together."""

import multiprocessing
import os
import pickle
import signal
import sys
import time
from collections.abc import Callable
from datetime import timedelta
from multiprocessing.connection import Connection, wait
from multiprocessing.pool import ExceptionWithTraceback  # type: ignore[attr-defined]
from pathlib import Path
from typing import Any

import torch.distributed
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm

from pipeline.engine.worker_processes import end_with_parent
from pipeline.errors import PipelineError, StageError
from pipeline.store.temporary import temporary_folder

REPORT_DELAY = 3.0
"""Seconds by which a process delays an unexpected error: if it has lost one that was killed, that one is reported."""
SILENCE = timedelta(minutes=10)
"""Longest wait for an answer of a running process: more than a checkpoint or the reading of a list of items takes."""


def run_processes(
    name: str,  # of the training, in messages
    count: int,
    device: torch.device,
    work: Callable[..., None],
    *arguments: Any,
) -> None:
    """Run `work(device, *arguments)` in processes that form torch's process group; the first error ends all of them."""
    context = multiprocessing.get_context("spawn")
    packed = pickle.dumps((work, arguments))  # torch's own way would share the memory of weights: each would step in the others'
    started, running = [], dict[Any, tuple[int, Any]]()
    with temporary_folder() as folder:
        try:
            for rank in range(count):
                ours, theirs = context.Pipe(duplex=False)
                with theirs:
                    process = context.Process(target=_join, args=(theirs, packed, device.type, rank, count, folder), daemon=True)
                    process.start()
                started.append(process)
                running[ours] = rank, process
            while running:
                for connection in wait([*running]):
                    rank, process = running.pop(connection)
                    try:
                        error: Any = connection.recv()  # type: ignore[union-attr,call-arg]
                    except EOFError:
                        process.join()
                        code = process.exitcode or 0
                        ended = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with status {code}"
                        error = StageError(
                            f"{name}: process {rank} of {count} {ended}; run the same command again: it goes on from its last checkpoint"
                        )
                    if error:
                        raise error
        finally:
            for process in started:
                process.kill()
                process.join()


def _join(connection: Connection, packed: bytes, kind: str, rank: int, count: int, folder: Path) -> None:
    """Join the process group and work; send the error, or None."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C is for the parent, which reports it
    end_with_parent()
    os.environ.setdefault("GLOO_SOCKET_IFNAME", "lo")  # no other machine has to reach this process
    device = torch.device(kind, rank) if kind == "cuda" else torch.device(kind)
    error: Any = None
    try:
        if kind == "cuda":
            torch.cuda.set_device(device)
        work, arguments = pickle.loads(packed)
        torch.distributed.init_process_group(
            "nccl" if kind == "cuda" else "gloo",
            init_method=(folder / "processes").as_uri(),  # torch's port would be open to the network
            rank=rank,
            world_size=count,
            timeout=SILENCE,
            device_id=device if kind == "cuda" else None,
        )
        work(device, *arguments)
    except (PipelineError, OSError) as raised:
        error = raised
    except Exception as raised:
        time.sleep(REPORT_DELAY)
        error = ExceptionWithTraceback(raised, raised.__traceback__)
    connection.send(error)
    sys.stdout.flush()
    os._exit(0)  # destructors of the process group may wait for others


class _Sum(torch.autograd.Function):
    """The sum over all processes, in both directions."""

    @staticmethod
    def forward(ctx: Any, value: Tensor) -> Tensor:
        total = value.clone()
        torch.distributed.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        return _Sum.forward(ctx, gradients[0].contiguous())


class SharedBatchNorm(_BatchNorm):
    """Normalise by the mean and variance of the whole batch, as one process would, on any device: torch's own needs GPUs.

    Weights and buffers are those of `nn.BatchNorm2d`. `share` is 1, or 0 if this process has no items of the batch: its
    results then have no weight.
    """

    share = 1.0

    def _check_input_dim(self, input: Tensor) -> None:
        """Take maps of any number of dimensions."""

    def forward(self, input: Tensor) -> Tensor:
        """Normalise (B, C, …) maps; in training, every process must call it."""
        if not self.training:
            return super().forward(input)
        maps = input.to(torch.promote_types(input.dtype, torch.float32))
        reduced, shape = [0, *range(2, maps.ndim)], [1, -1, *[1] * (maps.ndim - 2)]
        count = maps.new_tensor([maps.numel() / self.num_features])
        total = _sum(self.share * torch.cat([maps.sum(reduced), count]))
        mean, count = total[:-1] / total[-1], total[-1].detach()
        centred = maps - mean.view(shape)
        variance = _sum(self.share * centred.square().sum(reduced)) / count
        self._track(mean.detach(), variance.detach() * count / (count - 1))
        normalised = centred * (variance + self.eps).rsqrt().view(shape)
        return (normalised * self.weight.view(shape) + self.bias.view(shape)).to(input.dtype)

    def _track(self, mean: Tensor, variance: Tensor) -> None:
        """Move the running statistics, which evaluation normalises by, towards those of the batch."""
        assert self.running_mean is not None
        assert self.running_var is not None
        assert self.num_batches_tracked is not None
        self.num_batches_tracked += 1
        self.running_mean.lerp_(mean.to(self.running_mean), self.momentum or 0)
        self.running_var.lerp_(variance.to(self.running_var), self.momentum or 0)


def _sum(value: Tensor) -> Tensor:
    apply: Any = _Sum.apply  # torch does not declare its type
    total: Tensor = apply(value)
    return total


def share_batch_norm(module: nn.Module) -> list[SharedBatchNorm]:
    """Replace each batch normalisation inside a network by one that processes share; return the replacements."""
    replaced = []
    for parent in list(module.modules()):
        for name, child in parent.named_children():
            if isinstance(child, _BatchNorm):
                shared = SharedBatchNorm(child.num_features, child.eps, child.momentum)
                shared.load_state_dict(child.state_dict())
                setattr(parent, name, shared)
                replaced.append(shared)
    return replaced
