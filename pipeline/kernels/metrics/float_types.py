"""The floating types that geometry is computed in: half precision belongs inside networks, under autocast."""

from __future__ import annotations

import torch
from torch import Tensor


def check_full_precision(name: str, values: Tensor) -> None:
    """Refuse half precision and integers: at the scene's 0.6 m, bfloat16 goes in steps of 4 mm and float16 of 0.5 mm.

    Parameters
    ----------
    name
        What the message calls the values.
    values
        Any shape.

    Raises
    ------
    ValueError
        `values` is neither float32 nor float64.
    """
    if values.dtype not in (torch.float32, torch.float64):
        raise ValueError(
            f"{name} of type {values.dtype}: geometry takes the floating types float32 and float64; "
            "for half precision run a network under torch.autocast"
        )
