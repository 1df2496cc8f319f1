"""Implicit networks: signed distances to an object's surface from an image and touches.

Of touches a query is given the nearest touched point, and the nearest point that is known to be outside.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array
from pipeline.kernels.networks.image_encoder import ImageEncoder, MapGrid, pool_features, project_to_pixels
from pipeline.kernels.networks.network_configurations import ImplicitConfig
from pipeline.kernels.networks.touch_attention import Sites, TouchAttention
from pipeline.kernels.networks.touch_points import POINT_FEATURES, TOUCH_FEATURES, TouchPoints, heights_above_touches
from pipeline.kernels.tensors import COLOURS, draw_weights

CAMERA_FEATURES = 4  # position of a query in the camera's directions, and one radius over the distance of the camera
POOLED_SIDE = 4  # windows per side of the deepest map, of whose means a linear layer makes the global features of an image
INITIAL_OUTPUT_SCALE = 0.1  # of the usual size of initial weights, for the last ones of each residual block
FINGER_DEPTH = 0.015  # m beside an object of 0.5 m, as below: of the finger behind a touched point, where no object is
FOLLOWED_DEPTH = 0.004  # m below a touched point at which its tangent plane weighs 1/e: a thin object ends there
LEAST_REACH, REACH_PER_ERROR = 0.001, 4.0  # m to which a touch's plane is followed; how much farther per m of error
SMALLEST_REACH = 1e-6  # m: below this reach no point is near a touch; squares of shares of it leave float32
TANH_SLOPE = 0.05  # added to the tanh of distances, which alone is flat where most points are, and stops learning there


@dataclass(frozen=True)
class Encoding:
    """Encoded images and touches of B items; the K with an image are all, unless the network takes any inputs."""

    maps: list[Tensor]  # (K, channels, rows, columns) of each map that queries pool, the image itself first; or none
    cameras: Tensor | None  # (K, 3, 4) projection matrices; None without an image
    with_image: Tensor  # (K,) int64: the items that have an image
    overall: Tensor  # (B, G) global features
    touches: TouchPoints | None  # the items' touched points, in radii from the centre; None without touch
    sites: Sites | None = None  # the items' touches, for the attention to them; None without it


class ImplicitNetwork(nn.Module):
    """Predicts signed distances at query points.

    A query takes the image features at the pixel where it is seen (Saito et al., PIFu, 2019), which tell whether it is visibly free; the
    features of the touch nearest to it; and global features of the image and of all touches. A residual network predicts its distance.
    Equal generators of initial weights give equal networks.
    """

    def __init__(self, config: ImplicitConfig, generator: torch.Generator | None = None) -> None:
        super().__init__()
        self.config = config
        width, overall, of_pixel, is_of_gels = config.features, config.features // 2, 0, config.touch_points == "gels"
        self.encoder: ImageEncoder | None = None
        with torch.random.fork_rng(devices=[]):  # layers draw from torch's own generator; weights are drawn again from ours
            if config.image is not None:
                self.encoder = ImageEncoder(config)
                self.seen = nn.Linear(self.encoder.deepest * POOLED_SIDE**2, overall)
                of_pixel = COLOURS + self.encoder.channels + (config.image == "any")  # and whether there is an image
                of_pixel += CAMERA_FEATURES * config.of_camera
            if config.touch:
                self.felt = nn.Sequential(nn.Linear(POINT_FEATURES + is_of_gels, overall), nn.ReLU(), nn.Linear(overall, overall))
            codes = overall * ((config.image is not None) + config.touch)
            of_touch = (TOUCH_FEATURES + 2 * is_of_gels) * config.touch
            self.inputs = [3, codes, of_pixel, of_touch]  # of a query: its position, its item's codes, features
            self.first, self.last = nn.Linear(sum(self.inputs), width), nn.Linear(width, 1)
            self.attention = TouchAttention(width, config.attention) if config.touch and config.attention else None
            self.blocks = nn.ModuleList(
                nn.Sequential(nn.ReLU(), nn.Linear(width, width), nn.ReLU(), nn.Linear(width, width)) for _ in range(config.blocks)
            )
        draw_weights(self, generator)
        with torch.no_grad():
            for name, weight in self.named_parameters():
                if name.endswith((".3.weight", "told.weight", "last.weight")):
                    weight.mul_(INITIAL_OUTPUT_SCALE)

    def forward(self, queries: Tensor, **inputs: Any) -> Tensor:
        """Predict the signed distances (B, N), m, of queries (B, N, 3), world, m, from the parameters of `encode`."""
        return self.decode(self.encode(**inputs), queries)

    def encode(
        self,
        *,
        images: Tensor | None,  # (B, 3, H, W) in [0, 1]; None for a network without image
        camera: Tensor | None,  # (3, 4) or (B, 3, 4), world points to pixels of these images; 0 for an optional image that is missing
        touches: TouchPoints,  # world, m; P is 0 without touch
    ) -> Encoding:
        """Encode the inputs of B items, once for all queries."""
        optional, count = self.config.image == "any", len(touches.points)
        if ((images is not None) != (self.encoder is not None) and not optional) or (touches.points.shape[1] and not self.config.touch):
            raise ValueError(f"a network with image {self.config.image!r} and touch {self.config.touch} is given something else")
        maps, cameras, overall = [], None, [self.last.weight.new_zeros(count, 0)]
        with_image = torch.arange(0 if images is None else count, device=self.last.weight.device)
        if self.encoder is not None:
            image_code = self.last.weight.new_zeros(count, self.seen.out_features)
            if images is not None and camera is not None:
                cameras = camera.to(images).expand(len(images), 3, 4)
                if optional and not bool((has_image := cameras.any(dim=(1, 2))).all()):
                    with_image = torch.nonzero(has_image)[:, 0]
                    images, cameras = images[with_image], cameras[with_image]
            if images is not None and len(with_image):
                deep = self.encoder(images)
                maps = [images, *deep]
                seen = self.seen(functional.adaptive_avg_pool2d(deep[-1], POOLED_SIDE).flatten(1))
                image_code = image_code.to(seen).index_copy(0, with_image, seen)
            elif self.training:
                image_code = image_code + nothing_of(self.encoder, self.seen)
            overall.append(image_code)
        if self.config.touch:
            if not bool(torch.isfinite(touches.points).all()):
                raise InvalidInput("touched points have values that are not finite: leave out the items they come from")
            is_of_gels = touches.widths is not None and self.config.touch_points == "gels"
            widths = touches.widths / self.config.radius if is_of_gels and touches.widths is not None else None
            touches = replace(touches, points=self._unit(touches.points), widths=widths)
            overall.append(self._touch_code(touches))
        code = Encoding(maps, cameras, with_image, torch.cat(overall, dim=1), touches if self.config.touch else None)
        if self.attention is None or not bool(touches.touched.any()):
            return code
        middles = self.attention.middles(touches)
        untouched = replace(code, overall=torch.cat([*overall[:-1], torch.zeros_like(overall[-1])], dim=1))
        hidden = self._deepen(self._begin(untouched, middles))
        return replace(code, sites=self.attention.sites(touches, hidden, self._distances(hidden) / self.config.band))

    def _touch_code(self, touches: TouchPoints) -> Tensor:  # (B, G)
        """Compute the largest codes of each item's points, 0 at least; only the few points that have one are differentiated."""
        features, present = touches.point_features, touches.present
        code: Tensor = self.felt(features[:, :0]).sum(dim=1)  # zeros, whose gradients processes that share a step wait for
        for item in torch.nonzero(present.any(dim=1))[:, 0].tolist():
            with torch.no_grad():
                highest = self.felt(features[item, present[item]]).argmax(dim=0)
            code[item] = self.felt(features[item, highest]).diagonal().relu()
        return code

    def decode(self, code: Encoding, queries: Tensor) -> Tensor:
        """Predict the signed distances of queries (B, N, 3), m, world: (B, N) m, limited to about the band."""
        return self._decode(code, queries)[0]

    def _decode(self, code: Encoding, queries: Tensor) -> tuple[Tensor, tuple[Tensor, Tensor] | None]:
        """Predict as `decode`; a network with touch also returns what `TouchPoints.features_at` does."""
        unit, touch_features = self._unit(queries), None
        hidden = self._begin(code, unit)
        if code.touches is not None:
            touch_features = code.touches.features_at(unit)
            hidden = hidden + functional.linear(touch_features[0], torch.split(self.first.weight, self.inputs, dim=1)[-1])
        if code.sites is not None and self.attention is not None:
            hidden = hidden + self.attention(hidden, unit, code.sites)
        elif self.attention is not None:  # as of an item that nothing touches, beside others in training
            hidden = hidden + self.attention.told.bias + nothing_of(self.attention)
        return self._distances(self._deepen(hidden)), touch_features

    def _begin(self, code: Encoding, unit: Tensor) -> Tensor:
        """Compute the first features of queries (B, N, 3), radii, but for the touches near them: (B, N, features)."""
        of_position, of_item, of_pixel, _ = torch.split(self.first.weight, self.inputs, dim=1)
        hidden = functional.linear(unit, of_position) + functional.linear(code.overall, of_item, self.first.bias)[:, None]
        if self.encoder is None or not code.maps or code.cameras is None:
            return hidden
        seen = unit[code.with_image]
        pixels = project_to_pixels(code.cameras, self._world(seen))
        features = pool_features(code.maps, (MapGrid(), *self.encoder.grids), pixels)
        if self.config.of_camera:
            features = torch.cat([features, positions_in_view(code.cameras, seen, self.config)], dim=2)
        if self.config.image == "any":
            features = functional.pad(features, (0, 1), value=1)
        return hidden.index_add(0, code.with_image, functional.linear(features, of_pixel))

    def _deepen(self, hidden: Tensor) -> Tensor:
        for block in self.blocks:
            hidden = hidden + block(hidden)
        return hidden

    def _distances(self, hidden: Tensor) -> Tensor:  # (B, N) m
        last: Tensor = self.last(hidden.relu())[..., 0]
        return self.config.band * (torch.tanh(last) + TANH_SLOPE * last)

    def errors_at_touches(self, code: Encoding) -> Tensor | None:  # (B, P) m; None if no touch is followed
        """Predict the distances of touched points, which are truly 0; 0 for other points."""
        touches = code.touches
        if touches is None or self.config.touch_reach < SMALLEST_REACH or not bool(touches.touched.any()):
            return None
        predicted = self.decode(code, self._world(touches.points))
        return predicted * (touches.touched & touches.normals.any(dim=2))

    def decode_with_touches(
        self,
        code: Encoding,
        queries: Tensor,  # (B, N, 3) world, m
        errors: Tensor | None,  # (B, P) from `errors_at_touches`
    ) -> Tensor:  # (B, N) m
        """Predict distances as `decode`, corrected by the touches nearby: for reconstructions.

        A network learns from few points near touches, and misses them by millimetres where charts miss them by tenths. Its error at the
        nearest touched point is subtracted, with a weight that falls with distance. Then, at a distance d from that point and the finger
        above it, the height above its tangent plane has the weight exp(-(d / reach)⁴), and the network the remaining weight. Near the point
        this weight is flat: the height decides on the sign, however wrong the network is. The reach grows with the error: where the network
        is right, its curved surface is better than a plane, and a thin object has another side.
        """
        (predicted, touch_features), radius = self._decode(code, queries), self.config.radius
        if touch_features is None or errors is None:
            return predicted
        (features, nearest), reach = touch_features, self.config.touch_reach
        error = errors.gather(1, nearest)
        squared = features[..., :3].square().sum(dim=-1) * radius**2
        predicted = predicted - error * torch.exp(-squared / (2 * reach) ** 2)
        own_reach = (REACH_PER_ERROR * error.abs() + LEAST_REACH).clamp(max=reach) / radius
        below = min(FOLLOWED_DEPTH, reach) / radius
        heights, weights = heights_above_touches(features, own_reach, finger=FINGER_DEPTH / radius, below=below)
        return torch.lerp(predicted, radius * heights, weights)

    def touched_points(self, code: Encoding) -> Array:  # (M, 3) world, m
        """List the touched points of the items: distances change fast around them."""
        touches = code.touches
        touched = self.last.weight.new_zeros(0, 3) if touches is None else touches.points[touches.touched]
        return np.asarray(self.config.radius * touched.double().cpu().numpy() + np.array(self.config.centre))

    def _world(self, unit: Tensor) -> Tensor:
        """Convert radii from the centre to world, m."""
        return unit * self.config.radius + unit.new_tensor(self.config.centre)

    def _unit(self, points: Tensor) -> Tensor:
        """Convert world, m, to radii from the centre."""
        return (points.to(self.last.weight) - self.last.weight.new_tensor(self.config.centre)) / self.config.radius


def nothing_of(*layers: nn.Module) -> Tensor:
    """Compute 0 from all weights of layers: processes that share a step wait for the gradient of each weight, even if it is zero."""
    return 0 * torch.stack([weights.sum() for layer in layers for weights in layer.parameters()]).sum()


def positions_in_view(
    cameras: Tensor,  # (B, 3, 4) projection matrices
    queries: Tensor,  # (B, N, 3) radii from the centre
    config: ImplicitConfig,
) -> Tensor:  # (B, N, `CAMERA_FEATURES`)
    """Turn queries into the directions of the camera, columns, rows and forward, and tell how near the camera is."""
    matrices = cameras.to(queries)
    forward = matrices[:, 2, :3]
    across = [row - (row * forward).sum(dim=1, keepdim=True) * forward for row in (matrices[:, 0, :3], matrices[:, 1, :3])]
    axes = torch.stack([*(functional.normalize(axis, dim=1) for axis in across), forward], dim=1)
    depth = forward @ matrices.new_tensor(config.centre) + matrices[:, 2, 3]
    nearness = (config.radius / depth)[:, None, None].expand(*queries.shape[:2], 1)
    return torch.cat([queries @ axes.mT, nearness], dim=2)
