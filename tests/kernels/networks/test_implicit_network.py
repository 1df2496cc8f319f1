"""Implicit network: dependence on its inputs, and learning of a distance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from pipeline.errors import InvalidInput
from pipeline.kernels.networks.implicit_network import FINGER_DEPTH, IMPLICIT_CONFIGURATIONS, ImplicitConfig, ImplicitNetwork
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from tests.kernels.networks.test_deformation_network import inputs

SMALL = ImplicitConfig(image="occluded", touch=True, encoder_width=0.1, features=16, blocks=2, side=3)
COUNTS = [2, 0, 1]


def small(**changes: Any) -> ImplicitNetwork:
    return ImplicitNetwork(SMALL.model_copy(update=changes), torch.Generator().manual_seed(0)).double().eval()


def given(counts: list[int] = COUNTS, **changes: Any) -> dict[str, Any]:
    like = CONFIGURATIONS["occluded-touch"].model_copy(update={"side": 3, "encoder_layers": 12} | changes)
    return inputs(counts, like)


def queries(items: int, count: int = 20) -> torch.Tensor:
    drawn = torch.rand(items, count, 3, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    return 0.4 * drawn + torch.tensor([-0.2, -0.2, 0.4])


def test_implicit_configurations_have_the_inputs_of_the_supplements():
    for name, config in IMPLICIT_CONFIGURATIONS.items():
        if config.image == "any":
            continue
        other = CONFIGURATIONS[name.removeprefix("implicit-")]
        assert (config.image, config.touch) == (other.image, other.touch)


def test_items_and_queries_are_independent():
    network, seen, asked = small(), given(), queries(3)
    together = network(asked, **seen)
    assert together.shape == (3, 20)
    assert together.abs().max() < SMALL.band
    firsts = [0, 2, 2, 3]
    for item, count in enumerate(COUNTS):
        charts = slice(firsts[item], firsts[item + 1])
        alone = seen | {name: seen[name][charts] for name in ("touch_vertices", "touched")}
        alone |= {"images": seen["images"][item, None], "counts": [count]}
        torch.testing.assert_close(network(asked[item, None, 7:], **alone)[0], together[item, 7:])


@pytest.mark.parametrize("changed", ["images", "touch_vertices", "touched"])
def test_each_input_affects_its_own_item_only(changed):
    network, seen, asked = small(), given([1, 1]), queries(2)
    before = network(asked, **seen)
    other = seen[changed].clone()
    other[0] = ~other[0] if changed == "touched" else other[0] * 0.9
    after = network(asked, **(seen | {changed: other}))
    assert (after[0] != before[0]).any()
    torch.testing.assert_close(after[1], before[1])


def test_predictions_do_not_depend_on_the_order_of_grasps():
    network, seen, asked = small(), given([3]), queries(1)
    turned = seen | {name: seen[name].flip(0) for name in ("touch_vertices", "touched")}
    torch.testing.assert_close(network(asked, **turned), network(asked, **seen))


def test_equal_generators_give_equal_networks():
    first, second = small().state_dict(), small().state_dict()
    assert all(torch.equal(value, second[name]) for name, value in first.items())


def test_network_learns_the_distance_to_a_touched_ball():
    network = small(image=None, features=32, band=0.1).train()
    seen = given([2], image=None)
    asked = queries(1, 400)
    truth = (asked - torch.tensor([0, 0, 0.6])).norm(dim=2) - 0.12
    optimizer = torch.optim.Adam(network.parameters(), lr=5e-3)
    for _ in range(60):
        optimizer.zero_grad()
        loss = (network(asked, **seen) - truth.clamp(-0.1, 0.1)).abs().mean()
        loss.backward()
        optimizer.step()
    assert loss.item() < 0.3 * float(truth.clamp(-0.1, 0.1).abs().mean())


def test_decode_with_touches_follows_touches_nearby_and_the_network_far_away():
    network, seen = small(), given([1])
    flat = torch.tensor([[x, y, 0.6] for y in (0.02, 0.0, -0.02) for x in (-0.02, 0.0, 0.02)], dtype=torch.float64)  # faces +z
    seen |= {"touch_vertices": flat[None], "touched": torch.tensor([True])}
    code = network.encode(**seen)

    def both(*points: tuple[float, float, float]) -> tuple[torch.Tensor, torch.Tensor]:
        asked = torch.tensor([points], dtype=torch.float64)
        return network.decode_with_touches(code, asked)[0], network.decode(code, asked)[0]

    (on, above, below, *_), (alone, *_) = both((0.02, 0.02, 0.6), (0.02, 0.02, 0.601), (0.02, 0.02, 0.599))
    assert alone.abs() > 1e-4
    torch.testing.assert_close(torch.stack([on, above, below]), torch.tensor([0, 1e-3, -1e-3], dtype=torch.float64), atol=3e-6, rtol=0)
    assert on.abs() < 1e-12
    reach, weight = SMALL.touch_reach, np.exp(-1)
    trusting, alone = both(
        (0.0, 0.0, 0.6 - reach), (0.02 + reach, 0.0, 0.6), (0.0, 0.0, 0.6 + FINGER_DEPTH), (0.0, 0.0, 0.6 + FINGER_DEPTH + reach)
    )
    heights = torch.tensor([-reach, 0, FINGER_DEPTH, FINGER_DEPTH + reach], dtype=torch.float64)
    weights = torch.tensor([weight, weight, 1, weight], dtype=torch.float64)  # in the finger there is nothing
    torch.testing.assert_close(trusting, weights * heights + (1 - weights) * alone)
    torch.testing.assert_close(*both((0.0, 0.0, 0.7)))


@pytest.mark.parametrize("changes", [{"touch": False}, {"touch_reach": 0.0}, {"touch_reach": 1e-30}, {}])
def test_decode_with_touches_equals_decode_without_touch_or_reach(changes: dict[str, Any]):
    network, seen, asked = small(**changes), given([2 if changes.get("touch", True) else 0]), queries(1)
    if not changes:
        seen |= {"touched": torch.tensor([False, False])}
    code, asked = network.encode(**seen), torch.cat([asked, seen["touch_vertices"].reshape(1, -1, 3)], dim=1)
    assert torch.equal(network.decode_with_touches(code, asked), network.decode(code, asked))


def test_encode_rejects_superfluous_missing_or_infinite_input():
    seen, asked = given(), queries(3)
    with pytest.raises(ValueError, match="image 'occluded' and touch True is given something else"):
        small()(asked, **(seen | {"images": None, "camera": None}))
    with pytest.raises(ValueError, match="touch False is given something else"):
        small(touch=False)(asked, **seen)
    broken = seen["touch_vertices"].clone()
    broken[0, 0, 0] = torch.nan
    with pytest.raises(InvalidInput, match="not finite"):
        small()(asked, **(seen | {"touch_vertices": broken}))
