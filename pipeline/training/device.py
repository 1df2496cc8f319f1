"""Where networks run."""

from __future__ import annotations

import torch

from pipeline.errors import StageError


def device_of(accelerator: str) -> torch.device:
    """Find the device of that name; `auto` is a GPU where there is one. A `StageError` where it cannot be used."""
    if accelerator == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(accelerator)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise StageError(f"accelerator {accelerator} cannot be used ({error}); take auto or cpu") from error
    return device
