"""Batch normalisation of a batch that several processes share, on any device: torch's own `SyncBatchNorm` computes on GPUs alone."""

from typing import Any

import torch
import torch.distributed
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm


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
    """Normalise by the mean and variance of the whole batch, as one process would.

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
