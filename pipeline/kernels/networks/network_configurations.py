"""The supplement's deformation networks as data: the inputs and the size of each (Tables 6-11)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field

from pipeline.kernels.charts.touch_chart import MAX_SIDE
from pipeline.kernels.charts.vision_charts import MAX_SPLITS
from pipeline.kernels.geometry.normalise import DIAGONAL
from pipeline.kernels.networks.image_encoder import Norm

ImageKind = Literal["occluded", "unoccluded", "rendering", "any"]
Seams = Literal["open", "tied"]
TouchEdges = Literal["centres", "all"]

RADIUS = DIAGONAL / 2
"""m, of the ball that objects lie in, as networks see them. Lengths in settings of trainings are for these."""


class NetworkInputs(BaseModel):
    """The inputs of any network that reconstructs, and its image encoder; a family adds its own sizes.

    Attributes
    ----------
    image
        The image it takes, if any; "rendering" is one of several images of the object, each with its own camera; "any" is an occluded
        image, an unoccluded one or none, which may differ between items.
    touch
        Whether it takes touch charts and which of them touched.
    encoder_layers, encoder_kernel, encoder_norm, encoder_width
        The image encoder: its plan by number of layers, pixels per side of its kernels, its normalisation, its channels over the plan's.
    side
        Vertices along a side of a touch chart.
    centre, radius
        The ball that objects lie in, m, world. Networks see positions in units of the radius from the centre.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    image: ImageKind | None = None
    touch: bool = False
    encoder_layers: Literal[12, 15, 18, 25] = 18
    encoder_kernel: Literal[3, 5] = 3
    encoder_norm: Norm = "batch"
    encoder_width: float = Field(default=1.0, gt=0, le=64)
    side: int = Field(default=9, ge=3, le=MAX_SIDE)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.6)
    radius: float = Field(default=RADIUS, gt=0)

    def restricted_to(self, inputs: NetworkInputs) -> Self:
        """Describe this network with no other inputs than these."""
        return self.model_copy(update={"image": inputs.image, "touch": inputs.touch})


INPUT_CHOICES: Mapping[str, NetworkInputs] = {
    "none": NetworkInputs(),
    "touch": NetworkInputs(touch=True),
    "occluded": NetworkInputs(image="occluded"),
    "occluded-touch": NetworkInputs(image="occluded", touch=True),
    "unoccluded": NetworkInputs(image="unoccluded"),
    "unoccluded-touch": NetworkInputs(image="unoccluded", touch=True),
}
"""The combinations of inputs of a network that takes any."""


class NetworkConfig(NetworkInputs):
    """The inputs and sizes of a `DeformationNetwork`, whose sphere of vision charts starts as the ball that objects lie in.

    Attributes
    ----------
    encoder_linear
        Features that a linear layer with ReLU makes of the pooled ones (Table 11); none where it is None.
    gcn_layers, gcn_features, mixed
        The graph network: layers in all, features of each but the last, and the share of them averaged over neighbours.
    passes
        How often the vertices are moved, with the same weights.
    splits
        Vision charts: 24 · 4^splits of them.
    seams
        "tied": vision vertices that coincide move as one, by the mean of their predicted displacements; "open": each by its own.
    touch_edges
        "all": each vision vertex has the centres of its item's touch charts as neighbours, but not the reverse; "centres": the centres of
        vision charts and of touch charts are each other's neighbours.
    """

    encoder_linear: int | None = Field(default=None, gt=0, le=2**16)
    gcn_layers: int = Field(default=20, ge=2, le=1000)
    gcn_features: int = Field(default=200, ge=1, le=2**16)
    mixed: float = Field(default=1 / 3, ge=0, le=1)
    passes: int = Field(default=3, ge=1, le=100)
    splits: int = Field(default=1, ge=0, le=MAX_SPLITS)
    seams: Seams = "open"
    touch_edges: TouchEdges = "centres"


CONFIGURATIONS: Mapping[str, NetworkConfig] = {
    "none": NetworkConfig(gcn_layers=20, gcn_features=200),  # the size of Table 8
    "touch": NetworkConfig(touch=True, gcn_layers=15, gcn_features=250),  # Table 6
    "occluded-touch": NetworkConfig(image="occluded", touch=True, gcn_layers=20, gcn_features=250),  # Table 7
    "occluded": NetworkConfig(image="occluded", gcn_layers=20, gcn_features=200),  # Table 8
    "unoccluded-touch": NetworkConfig(image="unoccluded", touch=True, gcn_layers=25, gcn_features=200),  # Table 9
    "unoccluded": NetworkConfig(image="unoccluded", encoder_layers=12, gcn_layers=20, gcn_features=250),  # Table 10
}
"""The supplement's networks by name; a table's layers are one fewer here than it counts (its index is off by one)."""

SINGLE_IMAGE = NetworkConfig(
    image="rendering", encoder_layers=25, encoder_norm="instance", encoder_linear=250, gcn_layers=25, gcn_features=250
)
"""The network of the supplement's last experiment, Table 11."""
