"""`train-implicit`: learn the signed distance from any point in space to the object, from images and touches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import model_validator

from pipeline.config.settings import defining, setting
from pipeline.engine.stage import Cost
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.networks.network_configurations import IMPLICIT_CONFIGURATIONS, Norm
from pipeline.training.learner import Batch, ReconstructionLearner
from pipeline.training.settings import ReconstructionSettings, Schedule
from pipeline.training.training_stage import ReconstructionTraining
from schemas.distances import DISTANCES

if TYPE_CHECKING:
    import torch
    from torch import Tensor

    from pipeline.kernels.touch.touched_points import Touch
    from pipeline.models.observation import Observation
    from pipeline.training.items import Items

NEAR_TOUCHES = 16  # of how many points of an object the nearest to its touches is taken as near
MISPLACED = 0.5  # share of the items with image and touches that are displaced, if `placement_error` is not 0


class ImplicitSettings(ReconstructionSettings):
    """How signed distances are learned from images and touches; lengths are those of objects that are scaled to 0.5 m."""

    configurations = IMPLICIT_CONFIGURATIONS

    configuration: str = defining("implicit-unoccluded", f"which network: {', '.join(IMPLICIT_CONFIGURATIONS)}")
    features: int = setting(128, "of each layer of the decoder", ge=2, le=2**12)
    blocks: int = setting(3, "residual blocks of the decoder, of two layers each", ge=0, le=100)
    band: float = setting(
        0.03,
        "m, beyond which distances count the same: more than the 28 mm at which meshing is refined",
        gt=0,
        le=1,
    )
    spacing: float = setting(0.004, "of the grid of a reconstruction's mesh, m; half of it takes four times as long", ge=1.25e-3, le=0.05)
    touch_reach: float = setting(
        0.01,
        "m, largest distance to which a reconstruction follows touches where the network errs; 0 uses the network alone",
        ge=0,
        le=1,
    )
    encoder_layers: Literal[12, 15, 18] = setting(12, "as in Table 10")
    encoder_kernel: Literal[3, 5] = setting(5, "as `train-gcn`'s")
    encoder_norm: Norm | None = setting(
        None,
        "as `train-gcn`'s; with group the validation loss does not jump on its way, and ends where it does with batch; null takes "
        "group for implicit-any, whose batches have more or fewer images, and batch for the others",
    )
    encoder_width: float = setting(0.25, "share of the tables' channels", gt=0, le=2)
    learning_rate: float = setting(2e-3, "with the cosine schedule", gt=0, le=100)
    schedule: Schedule = setting("cosine", "rises for a twentieth of all steps, then falls to 0: distances settle in its last third")
    gradient_limit: float | None = setting(1.0, "norm to which a longer gradient is shortened before each step; null leaves it", gt=0)
    batch_size: int = setting(4, "as `train-gcn`'s: steps count more than the size of a batch", ge=1)
    epochs: int = setting(
        500, "half an hour of one core for 168 objects; draft's 100 take a fifth of it, and docs/results.md has what they leave", ge=1
    )
    queries: int = setting(500, "points per item at which distances are learned", ge=1)
    near_touches: float | None = setting(
        None,
        "share of these points that are drawn among the sixteenth of an object's that is nearest to the touches given; null: 0.3 for "
        "implicit-gels, else none",
        ge=0,
        le=1,
    )
    validation_queries: int = setting(4000, "points per validation item", ge=1)
    samples_per_object: int = setting(
        1, "per object and epoch; the grasp that each begins with is drawn where they are fewer than the grasps", ge=1
    )
    validation_items: int = setting(1, "items per validation object, with 1, 2, … grasps", ge=1)
    dropped_image: float = setting(0.2, "implicit-any alone: share of items without image; half of the others' is occluded", ge=0, le=1)
    dropped_grasps: float = setting(0.35, "implicit-any alone: share of items without touches, with an image or without", ge=0, le=1)
    dropped_touches: float | None = setting(
        None,
        "share of an item's touch charts that is dropped, drawn for each item; null: a tenth for implicit-any, else none",
        ge=0,
        lt=1,
    )
    placement_error: float = setting(
        0.0,
        "m, standard deviation of the error of an object's position along each axis; its size errs by this over 0.25 m. Half of the items "
        "with image and touches have such an error, as positions estimated from depth have",
        ge=0,
        le=0.1,
    )

    @model_validator(mode="after")
    def _norm_of_any(self) -> ImplicitSettings:
        if self.inputs.image == "any" and self.encoder_norm == "batch" and self.devices > 1:
            raise ValueError("encoder_norm=batch needs an image of some item in each process, which implicit-any may not have; take group")
        return self

    @property
    def dropped_inputs(self) -> tuple[float, float]:
        return self.dropped_image, self.dropped_grasps

    @property
    def share_near_touches(self) -> float:
        return (0.0 if self.inputs.takes_charts else 0.3) if self.near_touches is None else self.near_touches

    @property
    def touch_dropout(self) -> float:
        return (0.1 if self.inputs.image == "any" else 0.0) if self.dropped_touches is None else self.dropped_touches


class ImplicitLearner(ReconstructionLearner):
    """Minimise the mean error of the predicted distances, which are cut off at the band."""

    seeded_as = "train-implicit"

    def targets(
        self,
        items: Items,
        numbers: Sequence[int],
        observations: Sequence[Observation],
        generators: Sequence[torch.Generator],
        *,
        validates: bool,
    ) -> tuple[Tensor, Tensor]:
        """Draw points of each item, (B, N, 3) world, m, and their signed distances (B, N), m, scaled as its observation is."""
        import torch

        count = self.settings.validation_queries if validates else self.settings.queries
        share = 0.0 if validates else self.settings.share_near_touches
        queries, distances = [], []
        for item, observation, generator in zip(numbers, observations, generators, strict=True):
            object_id = items.object_of(item)
            points, point_distances = (items.rows.read(name, object_id) for name in ("query_points", "signed_distance"))
            rows = torch.randint(len(points), (count,), generator=generator).numpy()
            if share and observation.touched.any():
                near = rows[: round(share * count)]  # a view
                near[:] = nearest_rows(points, observation.touches)[near // NEAR_TOUCHES]
            queries.append(items.scaled(points[rows], object_id))
            distances.append(np.float32(items.scale(object_id)) * point_distances[rows])
        return torch.from_numpy(np.stack(queries)), torch.from_numpy(np.stack(distances))

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        """Read items as every family does, turned at random if cameras are anywhere, some at a wrong pose if the settings ask for it."""
        batch = super().read(items, generators)
        if self.config.of_camera:
            batch = self._turned(batch)
        return self._misplaced(batch) if self.settings.placement_error else batch

    def _turned(self, batch: Batch) -> Batch:
        """Turn each item about the vertical through its centre: which way an object faces is not known where its camera may be anywhere."""
        import torch

        observations, (queries, distances) = [], batch.targets
        for number, (observation, generator) in enumerate(zip(batch.observations, batch.generators, strict=True)):
            angle = 2 * math.pi * float(torch.rand((), generator=generator, dtype=torch.float64))
            observations.append(replace(observation, turn=angle))
            _move(queries, number, replace(observation, turn=angle, scale=1.0).placement(self.config.centre))
        return Batch(observations, (queries, distances), batch.generators)

    def _misplaced(self, batch: Batch) -> Batch:
        """Move half of the items with image and touches to a wrong pose."""
        import torch

        from pipeline.training.items import draw_misplacement, misplace

        config, deviation = self.config, self.settings.placement_error
        observations, (queries, distances) = list(batch.observations), batch.targets
        for number, (observation, generator) in enumerate(zip(batch.observations, batch.generators, strict=True)):
            motion = draw_misplacement(deviation, config.centre, config.radius, generator)
            is_chosen = float(torch.rand((), generator=generator, dtype=torch.float64)) < MISPLACED
            if is_chosen and observation.image is not None and observation.touched.any():
                observations[number] = misplace(observation.scaled(config.centre), motion, np.array(config.centre))
                _move(queries, number, motion)
                distances[number] *= float(motion[0, 0])  # the scale
        return Batch(observations, (queries, distances), batch.generators)

    def loss(self, network: Any, batch: Batch) -> Tensor:
        """Compute the mean absolute error of the distances within the band, as a share of the band."""
        like, (queries, distances) = next(network.parameters()), batch.targets
        predicted: Tensor = network(queries.to(like), **vars(self.stack(network, batch)))
        band: float = self.config.band
        loss: Tensor = (predicted - distances.to(like).clamp(-band, band)).abs().mean() / band
        return loss

    def errors(self, network: Any, batch: Batch) -> Tensor:
        """Give each item the mean error of the batch, (B,), as all items have the same number of points."""
        return self.loss(network, batch).expand(len(batch.observations))


def _move(queries: Tensor, item: int, motion: np.ndarray) -> None:
    """Move the points (N, 3) of an item, in place, by a similarity (4, 4)."""
    import torch

    queries[item] = torch.from_numpy(transform_points(motion, queries[item].double().numpy()).astype(np.float32))


def nearest_rows(points: np.ndarray, touches: Sequence[Touch]) -> np.ndarray:  # (N / `NEAR_TOUCHES` or one more,) int64
    """Find the rows of points (N, 3) that are nearest to the middles of touches, in the same frame and unit."""
    from scipy.spatial import cKDTree

    middles = np.array([touch.points.mean(axis=0) for touch in touches if touch.touched])
    return np.argsort(cKDTree(middles).query(points)[0], kind="stable")[: math.ceil(len(points) / NEAR_TOUCHES)]


class TrainImplicit(ReconstructionTraining):
    """Train a network that predicts signed distances, from which marching cubes make a closed surface."""

    name = "train-implicit"
    summary = "Train an implicit network: signed distances at any point, from an image or touches or both."
    settings_type = ImplicitSettings
    learner = ImplicitLearner
    target, arrays = DISTANCES, ("query_points", "signed_distance")

    def cost(self, settings: ImplicitSettings, objects: int) -> Cost:
        """Estimate the time per item on one core, in proportion to its points and the squared features."""
        item_seconds = 0.01 + 0.02 * settings.queries / 500 * (settings.features / 128) ** 2
        return Cost(seconds=objects * settings.samples_per_object * settings.epochs * item_seconds, kilobytes=3000)
