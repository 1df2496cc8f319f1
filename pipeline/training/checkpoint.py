"""Files of a training: the losses of its epochs, and the checkpoint from which a killed one continues to the same weights."""

import json
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import safetensors.torch
import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from pipeline.formats.file_content import regular_stat
from pipeline.store.atomic import write_atomically
from pipeline.store.storage import read_bytes

METRICS = "metrics.json"  # losses of each epoch of a finished training
FILE = ".checkpoint.safetensors"  # hidden, as it is no part of the model; it stays until the model is finished


@dataclass
class Progress:
    """Hold the progress of a training."""

    epoch: int = 0  # the next one
    step: int = 0  # the next one
    sums: float = 0.0  # of the losses of the epoch's finished steps
    seconds: float = 0.0
    best: int = 0  # number of the best epoch
    history: list[dict[str, float]] = field(default_factory=list)  # metrics of every finished epoch


def save(
    folder: Path,  # of the model
    module: nn.Module,
    optimizer: torch.optim.Optimizer,
    best: Mapping[str, Tensor],  # the best weights so far, by name
    progress: Progress,
) -> None:
    """Write a checkpoint."""
    tensors = {f"module/{name}": value for name, value in module.state_dict().items()}
    tensors |= {f"best/{name}": value for name, value in best.items()}
    for index, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{index}/{name}": torch.as_tensor(value) for name, value in moments.items()}
    stored = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    write_atomically(folder / FILE, safetensors.torch.save(stored, metadata={"progress": json.dumps(progress.__dict__)}))


def load(folder: Path, module: nn.Module, optimizer: torch.optim.Optimizer) -> tuple[dict[str, Tensor], Progress]:
    """Restore the weights and the optimizer's moments from the checkpoint in `folder`; return the best weights and the progress.

    The module must have the type and device that it is trained with: the moments take those of its parameters. Without a
    checkpoint, or with one that a crash of the machine truncated, nothing changes: the training starts from the beginning.
    """
    try:
        tensors, progress = _read(folder)
    except (FileNotFoundError, SafetensorError):
        return {}, Progress()
    module.load_state_dict(_below("module", tensors))
    parameters = [parameter for group in optimizer.param_groups for parameter in group["params"]]
    moments: dict[int, dict[str, Tensor]] = defaultdict(dict)
    for name, value in _below("optimizer", tensors).items():
        index, moment = name.split("/")
        if value.ndim:  # fused Adam goes through memory: moments must be laid out as their weights, perhaps channels last
            value = torch.empty_like(parameters[int(index)], dtype=value.dtype, device="cpu").copy_(value)
        moments[int(index)][moment] = value
    optimizer.load_state_dict(optimizer.state_dict() | {"state": moments})
    return _below("best", tensors), progress


def load_best(folder: Path) -> tuple[dict[str, Tensor], Progress]:
    """Read the best weights of the checkpoint in `folder`, and the progress."""
    tensors, progress = _read(folder)
    return _below("best", tensors), progress


def _read(folder: Path) -> tuple[dict[str, Tensor], Progress]:
    regular_stat(folder / FILE)
    with safe_open(folder / FILE, framework="pt") as file:
        return {name: file.get_tensor(name) for name in file.keys()}, Progress(**json.loads(file.metadata()["progress"]))  # noqa: SIM118


def _below(part: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(f"{part}/"): value for name, value in tensors.items() if name.startswith(f"{part}/")}


def read_metrics(folder: Path) -> list[dict[str, float]]:
    """Read the losses of each epoch of a finished training."""
    rows: list[dict[str, float]] = json.loads(read_bytes(folder / METRICS))
    return rows
