"""How images of presses are varied in training, so that a network overlooks what differs between photographs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.config.settings import setting
from pipeline.training.settings import TrainingSettings

if TYPE_CHECKING:
    import torch
    from torch import Tensor

DRIFT_SIDE = 3  # points per side between which drift is interpolated: it is smooth


class VariedPresses(TrainingSettings):
    """The settings of a training on varied images of presses."""

    image_gain: float = setting(
        0.07,
        "exposure and lamps differ between days: each colour's change is scaled by a factor within 1 ± this, and 1.5 times this in common",
        ge=0,
        lt=1,
    )
    image_noise: float = setting(
        1.0, "greatest standard deviation of pixel noise, levels; what photographs of 160 pixels have", ge=0, le=255
    )
    image_mix: float = setting(0.05, "share of each colour that shows in another at most: lamps and filters overlap", ge=0, lt=1)
    image_depth: float = setting(
        5.0, "standard deviation of light that grows with depth, levels per mm: less than contacts of one sensor differ", ge=0, le=255
    )
    image_blur: float = setting(0.8, "greatest standard deviation of blur, pixels: of lens, gel and camera", ge=0, le=10)
    image_drift: float = setting(
        6.0,
        "greatest standard deviation by which a photograph's light differs smoothly from the untouched one's, levels; much more hides the "
        "gel around a contact",
        ge=0,
        le=255,
    )


def vary_change(
    change: Tensor,  # (3, H, W) float32 image minus untouched image, levels
    depth: Tensor,  # (H, W) float32 mm, how deep the gel is drawn in
    settings: VariedPresses,  # give the ranges; at 0 each variation is off
    generator: torch.Generator,
) -> Tensor:
    """Vary the change of colours of one press.

    Variations are gain, mixed colours, light that grows with the depth, blur, drift, noise and shift.
    """
    import torch
    from torch.nn.functional import interpolate

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
    import torch
    from torch.nn.functional import conv2d, pad

    reach = max(1, round(3 * sigma))
    weights = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=image.dtype) / sigma) ** 2)
    weights = (weights / weights.sum()).view(1, 1, 1, -1)
    padded = pad(image[:, None], (reach, reach, reach, reach), mode="replicate")
    return conv2d(conv2d(padded, weights), weights.transpose(2, 3))[:, 0]
