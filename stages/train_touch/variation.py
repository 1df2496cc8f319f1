"""Random variation of simulated changes of colour: effects in photographs that a sensor's model does not have."""

import torch
from torch import Tensor
from torch.nn.functional import conv2d, interpolate, pad

from stages.train_touch.stage import TouchTrainingSettings

DRIFT_SIDE = 3
"""Points per side between which drift is interpolated: it is smooth."""


def vary_change(
    change: Tensor,  # (3, H, W) float32 image minus untouched image, levels
    depth: Tensor,  # (H, W) float32 mm, how deep the gel is drawn in
    settings: TouchTrainingSettings,  # give the ranges; at 0 each variation is off
    generator: torch.Generator,
) -> Tensor:
    """Vary the change of colours of one press.

    Variations are gain, mixed colours, light that grows with the depth, blur, drift, noise and shift.
    """

    def share(*shape: int) -> Tensor:
        return torch.rand(shape, generator=generator, dtype=torch.float32)

    gain = 1 + settings.image_gain * (2 * share(3) - 1) + 1.5 * settings.image_gain * (2 * share(1) - 1)
    mixing = torch.eye(3, dtype=torch.float32) + settings.image_mix * (2 * share(3, 3) - 1)
    varied = torch.einsum("ij,jhw->ihw", gain[:, None] * mixing, change)
    lit = torch.randn((3, 1, 1), generator=generator, dtype=torch.float32)
    varied = varied + settings.image_depth * lit * depth
    varied = _blurred(varied, settings.image_blur * float(share(1)))
    coarse = torch.randn((3, DRIFT_SIDE, DRIFT_SIDE), generator=generator, dtype=torch.float32)
    common = torch.randn((1, DRIFT_SIDE, DRIFT_SIDE), generator=generator, dtype=torch.float32)
    drift = interpolate((0.6 * coarse + common)[None], size=change.shape[1:], mode="bicubic", align_corners=True)[0]
    noise = torch.randn(change.shape, generator=generator, dtype=torch.float32)
    varied = varied + settings.image_drift * share(1) * drift + settings.image_noise * share(1) * noise
    return varied + settings.image_shift * (2 * share(3, 1, 1) - 1)


def _blurred(image: Tensor, sigma: float) -> Tensor:
    """Blur an image (3, H, W) by a Gaussian of standard deviation `sigma`, pixels."""
    if sigma < 0.1:
        return image
    reach = max(1, round(3 * sigma))
    weights = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=image.dtype) / sigma) ** 2)
    weights = (weights / weights.sum()).view(1, 1, 1, -1)
    padded = pad(image[:, None], (reach, reach, reach, reach), mode="replicate")
    return conv2d(conv2d(padded, weights), weights.transpose(2, 3))[:, 0]
