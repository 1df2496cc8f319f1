"""What `taxim` 1.4.1 needs of torchvision and torch_scatter, made of torch: torchvision's wheels load beside one build of torch only.

Neither is in what is timed but `scatter_min`, which shadows use.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import torch
from torch import Tensor


def resize(image: Tensor, size: list[int], interpolation: str) -> Tensor:
    """`torchvision.transforms.functional.resize` of a tensor (C, H, W), with its default antialiasing."""
    return torch.nn.functional.interpolate(image[None], size=size, mode=interpolation, antialias=True)[0]


def scatter_min(source: Tensor, index: Tensor, dim_size: int, out: Tensor) -> tuple[Tensor, None]:
    """`torch_scatter.scatter_min` along the last dimension into `out` (C, dim_size), without the arguments of the minima."""
    if out.shape[-1] != dim_size:
        raise ValueError(f"out has shape {tuple(out.shape)}; its last dimension must be dim_size, {dim_size}")
    return out.scatter_reduce_(-1, index.expand_as(source), source, "amin"), None


def load_taxim() -> Any:
    """A `taxim.Taxim` of the GelSight it ships, on torch and the CPU, beside stand-ins for the two packages."""
    stand_ins: dict[str, dict[str, Any]] = {
        "torch_scatter": {"scatter_min": scatter_min},
        "torchvision": {},
        "torchvision.transforms": {"InterpolationMode": type("InterpolationMode", (), {"BILINEAR": "bilinear"})},
        "torchvision.transforms.functional": {"resize": resize},
    }
    for name, contents in stand_ins.items():
        module = ModuleType(name)
        vars(module).update(contents)
        sys.modules.setdefault(name, module)
    from taxim import Taxim

    return Taxim(backend="torch", device="cpu")
