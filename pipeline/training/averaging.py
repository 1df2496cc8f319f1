"""The running average of a network's weights, which jumps less than the weights of the last step do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn


def running_average(module: nn.Module, decay: float | None) -> AveragedModel | None:
    """Begin an exponential average of weights and of batch normalisation's statistics; None where `decay` is."""
    if decay is None:
        return None
    exponential: Any = get_ema_multi_avg_fn  # torch does not declare its type
    return AveragedModel(module, multi_avg_fn=exponential(decay), use_buffers=True)


@contextmanager
def averaged(module: nn.Module, average: AveragedModel | None) -> Iterator[None]:
    """Give the network its averaged weights for a while, if there are any."""
    if average is None:
        yield
        return
    kept = {name: value.detach().clone() for name, value in module.state_dict().items()}
    module.load_state_dict(average.module.state_dict())
    try:
        yield
    finally:
        module.load_state_dict(kept)
