"""`train-implicit`: learn the signed distance from any point in space to the object, from what is seen and felt."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from pipeline.engine.stage import Cost
from pipeline.kernels.networks.implicit_network import ImplicitNetwork
from pipeline.models.implicit_reconstruction import MARGIN
from pipeline.training.items import Items
from pipeline.training.reconstruction import Materials, ReconstructionTraining
from schemas.distances import DISTANCES
from stages.train_implicit.learner import LEARNED, ImplicitLearner
from stages.train_implicit.settings import ImplicitSettings


class TrainImplicit(ReconstructionTraining):
    """Trains a network that predicts signed distances, from which marching cubes make a closed surface."""

    name = "train-implicit"
    summary = "Train an implicit network: signed distances at any point, from an image or touches or both."
    settings_type = ImplicitSettings
    target = DISTANCES
    learned = LEARNED

    def cost(self, settings: ImplicitSettings, objects: int) -> Cost:
        """Estimate what an item takes on one core, in proportion to its points and the squared features."""
        each = 0.01 + 0.02 * settings.queries / 500 * (settings.features / 128) ** 2
        return Cost(seconds=objects * settings.items * settings.epochs * each, kilobytes=3000)

    def network(self, settings: ImplicitSettings, side: int, generator: torch.Generator) -> ImplicitNetwork:
        """Make the network, for touch charts of side x side vertices."""
        return ImplicitNetwork(settings.network(side), generator)

    def remarks(self, network: ImplicitNetwork, items: Items) -> Iterator[str]:
        """Say how many objects are larger than what is meshed, and which most."""
        yield from super().remarks(network, items)
        config, beyond = network.config, []
        for object_id in items.rows.object_ids:
            points, apart = (items.rows.read(array, object_id) for array in LEARNED)
            if (reach := np.abs(points[apart <= 0] - config.centre).max(initial=0.0)) > MARGIN * config.radius:
                beyond.append((float(reach), object_id))
        if beyond:
            reach, farthest = max(beyond)
            yield (
                f"{len(beyond)} of {len(items.rows)} objects to learn from are larger than the cube in which surfaces are looked for, and "
                f"such ones are cut off {MARGIN * config.radius:.2f} m from its middle: {farthest} reaches {reach:.2f} m; state a smaller "
                "unit with --units, or leave it out where the files state none: then they are scaled"
            )

    def learner(self, network: ImplicitNetwork, materials: Materials) -> ImplicitLearner:
        """Make what trains the network."""
        return ImplicitLearner(network, materials)
