"""Stand-ins of torch for what `taxim` 1.4.1 uses of torch_scatter and of torchvision, whose wheels load beside one build of torch."""

import sys
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

import torch
from torch import Tensor


def resize(image: Tensor, size: list[int], interpolation: str) -> Tensor:
    """Resize a tensor (C, H, W) as `torchvision.transforms.functional.resize` does, with its default antialiasing."""
    return torch.nn.functional.interpolate(image[None], size=size, mode=interpolation, antialias=True)[0]


def scatter_min(source: Tensor, index: Tensor, dim_size: int, out: Tensor) -> tuple[Tensor, None]:
    """Do `torch_scatter.scatter_min` along the last dimension into `out` (C, dim_size), without the arguments of the minima."""
    return out.scatter_reduce_(-1, index.expand_as(source), source, "amin"), None


def stand_in() -> None:
    """Put the stand-ins where `import` finds them, unless they are imported already."""
    stand_ins: dict[str, dict[str, Any]] = {
        "torch_scatter": {"scatter_min": scatter_min},
        "torchvision": {},
        "torchvision.transforms": {"InterpolationMode": type("InterpolationMode", (), {"BILINEAR": "bilinear"})},
        "torchvision.transforms.functional": {"resize": resize},
    }
    for name, contents in stand_ins.items():
        module = ModuleType(name)
        module.__spec__ = ModuleSpec(name, None)  # others ask with `find_spec` whether it is there
        vars(module).update(contents)
        sys.modules.setdefault(name, module)


def load_taxim() -> Any:
    """Make a `taxim.Taxim` of the GelSight it ships, on torch and the CPU."""
    stand_in()
    from taxim import Taxim

    return Taxim(backend="torch", device="cpu")
