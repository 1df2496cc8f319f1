"""Checkpoints: everything a killed training needs to go on to the same weights, in one file that is there whole or not at all."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import safetensors.torch
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file
from torch import Tensor, nn

from pipeline.formats.file_content import regular_stat
from pipeline.store.atomic import write_at_once

FILE = "checkpoint.safetensors"


@dataclass
class Progress:
    """How far a training is.

    `epoch` and `step` are the next to be done; `sums` adds up the losses of the epoch's finished steps; `history` has the
    metrics of every finished epoch; `best` is the number of the best one.
    """

    epoch: int = 0
    step: int = 0
    sums: float = 0.0
    seconds: float = 0.0
    best: int = 0
    history: list[dict[str, float]] = field(default_factory=list)


@dataclass(frozen=True)
class State:
    """What a training changes beside its progress: the network, Adam, and the running average of the weights, where one is taken."""

    module: nn.Module
    optimizer: torch.optim.Optimizer
    average: nn.Module | None = None

    @property
    def modules(self) -> dict[str, nn.Module]:
        """Name the modules as the file does."""
        return {"module": self.module} | ({} if self.average is None else {"average": self.average})


def save(folder: Path, state: State, best: Mapping[str, Tensor], progress: Progress) -> None:
    """Write the weights, the optimizer's moments, the best weights so far and the progress."""
    tensors = {f"{part}/{name}": value for part, module in state.modules.items() for name, value in module.state_dict().items()}
    tensors |= {f"best/{name}": value for name, value in best.items()}
    for index, moments in state.optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{index}/{name}": torch.as_tensor(value) for name, value in moments.items()}
    kept = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    write_at_once(folder / FILE, safetensors.torch.save(kept, metadata={"progress": json.dumps(progress.__dict__)}))


def load(folder: Path, state: State) -> tuple[dict[str, Tensor], Progress]:
    """Bring the state to where the checkpoint in `folder` left it; return the best weights and the progress.

    The modules must have the type and device they are trained with: moments are brought to those of their parameters. Without a
    checkpoint, or with one that a crash of the machine cut short, everything stays as it is: a fresh start.
    """
    try:
        regular_stat(folder / FILE)
        tensors = load_file(folder / FILE)
        with safe_open(folder / FILE, framework="pt") as file:
            progress = Progress(**json.loads(file.metadata()["progress"]))
    except (FileNotFoundError, SafetensorError):
        return {}, Progress()
    for part, module in state.modules.items():
        module.load_state_dict(_below(part, tensors))
    moments: dict[int, dict[str, Tensor]] = defaultdict(dict)
    for name, value in _below("optimizer", tensors).items():
        index, moment = name.split("/")
        moments[int(index)][moment] = value
    state.optimizer.load_state_dict(state.optimizer.state_dict() | {"state": moments})
    return _below("best", tensors), progress


def load_best(folder: Path) -> dict[str, Tensor]:
    """Read the best weights of the checkpoint in `folder`."""
    return _below("best", load_file(folder / FILE))


def _below(part: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(f"{part}/"): value for name, value in tensors.items() if name.startswith(f"{part}/")}


def discard(folder: Path) -> None:
    """Forget the checkpoint of a training that has ended, and what a killed one left of another."""
    for path in folder.glob(f"{FILE}*"):
        path.unlink()
