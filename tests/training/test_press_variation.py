"""Variation of images of presses: as much as set, none at 0."""

import torch

from pipeline.training.press_variation import vary_change
from stages.train_touch import TouchTrainingSettings

OFF = dict.fromkeys(("image_gain", "image_noise", "image_mix", "image_depth", "image_blur", "image_drift"), 0.0)


def chance(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_variation_is_off_at_zero_and_follows_from_the_generator() -> None:
    change = 30 * torch.randn(3, 20, 20, generator=torch.Generator().manual_seed(0))
    depth, off = torch.rand(20, 20, generator=torch.Generator().manual_seed(1)), TouchTrainingSettings.model_validate(OFF)
    torch.testing.assert_close(vary_change(change, depth, off, chance()), change)
    on = TouchTrainingSettings()
    first, second, other = (vary_change(change, depth, on, chance(seed)) for seed in (1, 1, 2))
    assert torch.equal(first, second)
    assert not torch.equal(first, other)
    for name in OFF:
        alone = TouchTrainingSettings.model_validate(OFF | {name: getattr(on, name)})
        assert not torch.allclose(vary_change(change, depth, alone, chance(5)), change, atol=1e-3), name


def test_colour_shift_is_the_same_for_all_pixels() -> None:
    change, settings = torch.zeros(3, 20, 20), TouchTrainingSettings.model_validate(OFF | {"image_shift": 9.0})
    shift = vary_change(change, change[0], settings, chance())
    assert shift.flatten(1).unique(dim=1).shape == (3, 1)
    assert 1 < shift.abs().max() <= 9
