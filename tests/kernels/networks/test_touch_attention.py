"""What queries learn of all touches, and of where the camera is."""

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from pipeline.kernels.networks.implicit_network import ImplicitConfig, ImplicitNetwork, positions_in_view
from pipeline.kernels.networks.touch_points import TouchPoints, pad_touches
from pipeline.kernels.touch.touched_points import Touch

CONFIG = ImplicitConfig(image=None, touch=True, touch_points="gels", features=16, blocks=1, attention=8)
WEIGHTS = torch.zeros((), dtype=torch.float64)


def network(**changes: Any) -> ImplicitNetwork:
    return ImplicitNetwork(CONFIG.model_copy(update=changes), torch.Generator().manual_seed(1)).double()


def touch(seed: int, count: int = 5) -> Touch:
    """Make a touch of `count` points near the middle of the networks' ball."""
    rng = np.random.default_rng(seed)
    points = (rng.normal(scale=0.01, size=(count, 3)) + rng.normal(scale=0.1, size=3) + CONFIG.centre).astype(np.float32)
    normals = np.tile(np.float32([0, 0, 1]), (count, 1))
    return Touch(points, normals, points[:1] + np.float32(0.02), normals[:1], width=0.08)


def asked(items: int) -> torch.Tensor:
    drawn = torch.rand(items, 7, 3, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    return 0.3 * (drawn - 0.5) + torch.tensor(CONFIG.centre, dtype=torch.float64)


def predict(net: ImplicitNetwork, touches: TouchPoints, queries: torch.Tensor) -> torch.Tensor:
    return net(queries, images=None, camera=None, touches=touches)


def test_the_order_of_touches_and_items_with_more_of_them_change_nothing():
    net, touches = network(), [touch(number) for number in range(3)]
    alone = predict(net, pad_touches([touches], WEIGHTS), asked(1))
    turned = predict(net, pad_touches([touches[::-1]], WEIGHTS), asked(1))
    beside_others = predict(net, pad_touches([touches, [touch(number, 9) for number in range(6)], []], WEIGHTS), asked(1).expand(3, -1, -1))
    torch.testing.assert_close(turned, alone)
    torch.testing.assert_close(beside_others[:1], alone)


def test_each_query_learns_of_a_touch_that_is_not_the_nearest():
    net, near, far = network(), touch(0), touch(1)
    moved = replace(far, points=far.points + np.float32([0, 0, 0.03]))
    queries = torch.from_numpy(near.points).double()[None]
    codes = [net.encode(images=None, camera=None, touches=pad_touches([[near, other]], WEIGHTS)) for other in (far, moved)]
    same = [replace(code, overall=codes[0].overall) for code in codes]  # the code of all touches is the same: attention alone differs
    torch.testing.assert_close(same[0].touches.features_at(net._unit(queries))[0], same[1].touches.features_at(net._unit(queries))[0])
    assert (net.decode(same[0], queries) - net.decode(same[1], queries)).abs().min() > 1e-9


def test_an_item_without_touch_is_predicted_alone_as_beside_touched_ones():
    net = network()
    torch.nn.init.normal_(net.attention.told.bias, generator=torch.Generator().manual_seed(2))  # as training leaves it
    free = replace(touch(0), points=np.zeros((0, 3), np.float32), normals=np.zeros((0, 3), np.float32))
    for touches in ([], [free]):
        alone = predict(net, pad_touches([touches], WEIGHTS), asked(1))
        beside = predict(net, pad_touches([touches, [touch(1), touch(2)]], WEIGHTS), asked(1).expand(2, -1, -1))
        torch.testing.assert_close(alone, beside[:1])


def test_all_weights_have_gradients_also_without_a_touch():
    for touches in ([touch(0), touch(1)], []):
        net = network().train()
        predict(net, pad_touches([touches], WEIGHTS), asked(1)).sum().backward()
        assert all(parameter.grad is not None for parameter in net.parameters())


def test_queries_know_where_they_are_for_the_camera():
    centre, radius, distance = np.array(CONFIG.centre), CONFIG.radius, 0.7
    right, down, forward = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])  # a camera on +x that looks at the centre
    pose = np.stack([right, down, forward])
    pixels = np.array([[400.0, 0, 128], [0, 410, 120], [0, 0, 1]])
    camera = pixels @ np.column_stack([pose, -pose @ (centre - distance * forward)])
    points = torch.tensor([[[0.5, 0, 0], [0, 0.25, 0], [0, 0, 0.125]]], dtype=torch.float64)  # radii from the centre
    seen = positions_in_view(torch.tensor(camera)[None], points, CONFIG)[0].numpy()
    near = radius / distance
    np.testing.assert_allclose(seen, [[0, 0, -0.5, near], [0.25, 0, 0, near], [0, -0.125, 0, near]], atol=1e-12)
