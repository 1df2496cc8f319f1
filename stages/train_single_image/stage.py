"""Supplement 3.6: learn to deform a sphere of vision charts to the object of one rendering."""

from __future__ import annotations

from typing import Any, ClassVar

from pipeline.models.trained_networks import SINGLE_IMAGE_MODEL, model_name
from schemas.base import Artifact
from schemas.renderings import RENDERINGS
from schemas.surfaces import SURFACES
from stages.train_gcn.settings import GcnSettings
from stages.train_gcn.stage import TrainGcn
from stages.train_single_image.settings import SingleImageSettings


class TrainSingleImage(TrainGcn):
    """Trains the network of Table 11 as `train-gcn` trains the others, on renderings."""

    name = "train-single-image"
    summary = "Train the graph network that deforms vision charts to the object of a single rendering."
    settings_type: ClassVar[type[GcnSettings]] = SingleImageSettings

    def inputs(self, settings: GcnSettings) -> tuple[Artifact, ...]:
        """Name what is read: the objects' points and renderings."""
        return (SURFACES, RENDERINGS)

    def writes(self, settings: GcnSettings) -> str:
        """Name the folder of the model."""
        return model_name(SINGLE_IMAGE_MODEL)

    def grid(self, settings: GcnSettings) -> dict[str, tuple[Any, ...]]:
        """Give none: the supplement searched none here."""
        return {}
