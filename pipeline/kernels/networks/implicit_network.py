"""Implicit networks: signed distances to an object's surface from an image and touches.

Of touches a query is given the nearest touched point, and the nearest point that is known to be outside.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array
from pipeline.kernels.metrics.chamfer import SearchCloud
from pipeline.kernels.networks.image_encoder import ImageEncoder, MapGrid, pool_features, project_to_pixels
from pipeline.kernels.networks.network_configurations import ImplicitConfig
from pipeline.kernels.tensors import COLOURS, draw_weights
from pipeline.kernels.touch.touched_points import Touch

NEAREST_POINT_FEATURES = 9  # offset, normal, height above the tangent plane, and how close the point is, at two scales
TOUCH_FEATURES = 2 * NEAREST_POINT_FEATURES  # of the nearest point that was touched, and of the nearest known to be outside
POINT_FEATURES = 7  # position, normal, and whether it was touched; networks of gels have the gel's width too, here and above
SCALES = (0.04, 0.2)  # radii of an object, 1 and 5 cm: closeness is exp(-distance / scale)
POOLED_SIDE = 4  # windows per side of the deepest map, of whose means a linear layer makes the global features of an image
INITIAL_OUTPUT_SCALE = 0.1  # of the usual size of initial weights, for the last ones of each residual block
FINGER_DEPTH = 0.015  # m beside an object of 0.5 m, as below: of the finger behind a touched point, where no object is
FOLLOWED_DEPTH = 0.004  # m below a touched point at which its tangent plane weighs 1/e: a thin object ends there
LEAST_REACH, REACH_PER_ERROR = 0.001, 4.0  # m to which a touch's plane is followed; how much farther per m of error
SMALLEST_REACH = 1e-6  # m: below this reach no point is near a touch; squares of shares of it leave float32
TANH_SLOPE = 0.05  # added to the tanh of distances, which alone is flat where most points are, and stops learning there


@dataclass(frozen=True)
class TouchPoints:
    """What sensors feel of B items, padded to P points, the most of an item; padding is neither touched nor outside."""

    points: Tensor  # (B, P, 3) world, m; in a network, radii from the centre
    normals: Tensor  # (B, P, 3) unit normals, away from the object
    widths: Tensor | None  # (B, P) of the gel that each point is of, in the unit of the points; None in a network that is not given it
    touched: Tensor  # (B, P) bool: points that were touched
    outside: Tensor  # (B, P) bool: points that are known to be free

    @property
    def present(self) -> Tensor:  # (B, P) bool
        """Find the entries that are no padding."""
        return self.touched | self.outside

    @property
    def point_features(self) -> Tensor:
        """Describe each point: (B, P, `POINT_FEATURES`, or one more)."""
        widths = [] if self.widths is None else [self.widths]
        return torch.cat([self.points, self.normals, *(values.to(self.points)[..., None] for values in (self.touched, *widths))], dim=2)

    def features_at(self, queries: Tensor) -> tuple[Tensor, Tensor]:  # (B, N, `TOUCH_FEATURES`, or two more), (B, N) int64
        """Compute features of queries (B, N, 3), radii, zeros where no point counts, and the numbers of the nearest touched points."""
        if not self.points.shape[1]:
            count = TOUCH_FEATURES + 2 * (self.widths is not None)
            return queries.new_zeros(*queries.shape[:2], count), queries.new_zeros(queries.shape[:2], dtype=torch.int64)
        nearest = [self._nearest(queries, clouds) for clouds in self._clouds]
        pairs = zip(nearest, (self.touched, self.outside), strict=True)
        return torch.cat([self._features(queries, *pair) for pair in pairs], dim=2), nearest[0]

    @cached_property
    def _clouds(self) -> list[list[tuple[Tensor, SearchCloud | None]]]:
        """Per side, touched and outside, and item: the numbers of the points there, and their cloud."""
        sides = [[torch.nonzero(counted)[:, 0] for counted in among] for among in (self.touched, self.outside)]
        return [
            [(numbers, SearchCloud(points[numbers]) if len(numbers) else None) for points, numbers in zip(self.points, side, strict=True)]
            for side in sides
        ]

    def _nearest(self, queries: Tensor, clouds: Sequence[tuple[Tensor, SearchCloud | None]]) -> Tensor:
        nearest = queries.new_zeros(queries.shape[:2], dtype=torch.int64)
        for item, (numbers, cloud) in enumerate(clouds):
            if cloud is not None:
                nearest[item] = numbers[cloud.nearest(queries[item])]
        return nearest

    def _features(self, queries: Tensor, nearest: Tensor, among: Tensor) -> Tensor:
        at = nearest[..., None].expand(-1, -1, 3)
        offset, normal = queries - self.points.gather(1, at), self.normals.gather(1, at)
        height = (offset * normal).sum(dim=2, keepdim=True)
        distance = offset.norm(dim=2, keepdim=True)
        widths = [] if self.widths is None else [self.widths.gather(1, nearest)[..., None]]
        features = torch.cat([offset, normal, height, *(torch.exp(-distance / scale) for scale in SCALES), *widths], dim=2)
        return features * among.any(dim=1)[:, None, None]


def heights_above_touches(
    features: Tensor,  # (..., `TOUCH_FEATURES`) of the queries
    reach: Tensor,  # (...) distance at which a height's weight is 1/e, radii
    *,
    finger: float,  # depth of the finger above the plane, radii: height up to it adds nothing to the distance
    below: float,  # depth below the plane at which a height's weight is 1/e, radii: the object may be thin
) -> tuple[Tensor, Tensor]:  # heights (...), radii; weights (...) exp(-(distance / reach)⁴), zeros where nothing was touched
    """Compute the heights of queries above the tangent planes of the nearest touched points; the object cannot be in the finger."""
    offset, normal, height = features[..., :3], features[..., 3:6], features[..., 6]
    across = offset.square().sum(dim=-1) - height.square()
    along = (height - finger).clamp(min=0) / reach + height.clamp(max=0) / below
    return height, torch.exp(-((across / reach**2 + along.square()) ** 2)) * normal.any(dim=-1)


def pad_touches(items: Sequence[Sequence[Touch]], like: Tensor) -> TouchPoints:
    """Pad what is felt of each of B items to the most points of an item, with the device and type of `like`; world, m."""
    most = max((sum(len(touch.points) + len(touch.free) for touch in touches) for touches in items), default=0)
    points, normals = np.zeros((2, len(items), most, 3), np.float32)
    widths, is_touched, is_free = np.zeros((len(items), most), np.float32), *np.zeros((2, len(items), most), bool)
    for item, touches in enumerate(items):
        start = 0
        for touch in touches:
            for flags, cloud, directions in ((is_touched, touch.points, touch.normals), (is_free, touch.free, touch.free_normals)):
                rows = slice(start, start := start + len(cloud))
                points[item, rows], normals[item, rows], widths[item, rows], flags[item, rows] = cloud, directions, touch.width, True
    felt = [torch.from_numpy(values).to(like) for values in (points, normals, widths)]
    return TouchPoints(*felt, *(torch.from_numpy(flags).to(like.device) for flags in (is_touched, is_free)))


@dataclass(frozen=True)
class Encoding:
    """Encoded images and touches of B items; the K with an image are all, unless the network takes any inputs."""

    maps: list[Tensor]  # (K, channels, rows, columns) of each map that queries pool, the image itself first; or none
    cameras: Tensor | None  # (K, 3, 4) projection matrices; None without an image
    with_image: Tensor  # (K,) int64: the items that have an image
    overall: Tensor  # (B, G) global features
    touches: TouchPoints | None  # the points of the items' touch charts; None without touch


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
            if config.touch:
                self.felt = nn.Sequential(nn.Linear(POINT_FEATURES + is_of_gels, overall), nn.ReLU(), nn.Linear(overall, overall))
            codes = overall * ((config.image is not None) + config.touch)
            of_touch = (TOUCH_FEATURES + 2 * is_of_gels) * config.touch
            self.inputs = [3, codes, of_pixel, of_touch]  # of a query: its position, its item's codes, features
            self.first, self.last = nn.Linear(sum(self.inputs), width), nn.Linear(width, 1)
            self.blocks = nn.ModuleList(
                nn.Sequential(nn.ReLU(), nn.Linear(width, width), nn.ReLU(), nn.Linear(width, width)) for _ in range(config.blocks)
            )
        draw_weights(self, generator)
        scaled = [weight for name, weight in self.blocks.named_parameters() if name.endswith("3.weight")]
        with torch.no_grad():
            for weight in (self.last.weight, *scaled):
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
            elif self.training:  # processes that share a step wait for the gradient of each weight, even if it is zero
                image_code = image_code + 0 * sum(weights.sum() for layer in (self.encoder, self.seen) for weights in layer.parameters())
            overall.append(image_code)
        if self.config.touch:
            if not bool(torch.isfinite(touches.points).all()):
                raise InvalidInput("touched points have values that are not finite: leave out the items they come from")
            is_of_gels = touches.widths is not None and self.config.touch_points == "gels"
            widths = touches.widths / self.config.radius if is_of_gels and touches.widths is not None else None
            touches = replace(touches, points=self._unit(touches.points), widths=widths)
            overall.append(self._touch_code(touches))
        return Encoding(maps, cameras, with_image, torch.cat(overall, dim=1), touches if self.config.touch else None)

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
        of_position, of_item, of_pixel, of_touch = torch.split(self.first.weight, self.inputs, dim=1)
        hidden = functional.linear(unit, of_position) + functional.linear(code.overall, of_item, self.first.bias)[:, None]
        if self.encoder is not None and code.maps and code.cameras is not None:
            pixels = project_to_pixels(code.cameras, queries[code.with_image])
            features = pool_features(code.maps, (MapGrid(), *self.encoder.grids), pixels)
            if self.config.image == "any":
                features = functional.pad(features, (0, 1), value=1)
            hidden = hidden.index_add(0, code.with_image, functional.linear(features, of_pixel))
        if code.touches is not None:
            touch_features = code.touches.features_at(unit)
            hidden = hidden + functional.linear(touch_features[0], of_touch)
        for block in self.blocks:
            hidden = hidden + block(hidden)
        last: Tensor = self.last(hidden.relu())[..., 0]
        return self.config.band * (torch.tanh(last) + TANH_SLOPE * last), touch_features

    def errors_at_touches(self, code: Encoding) -> Tensor | None:  # (B, P) m; None if no touch is followed
        """Predict the distances of touched points, which are truly 0; 0 for other points."""
        touches = code.touches
        if touches is None or self.config.touch_reach < SMALLEST_REACH or not bool(touches.touched.any()):
            return None
        predicted = self.decode(code, touches.points * self.config.radius + touches.points.new_tensor(self.config.centre))
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

    def _unit(self, points: Tensor) -> Tensor:
        """Convert world, m, to radii from the centre."""
        return (points.to(self.last.weight) - self.last.weight.new_tensor(self.config.centre)) / self.config.radius
