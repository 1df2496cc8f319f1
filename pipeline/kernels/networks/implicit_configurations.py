"""Implicit networks as data: the inputs and the size of each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.kernels.charts.touch_chart import MOST_SIDE
from pipeline.kernels.networks.image_encoder import Norm
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS, ImageKind, NetworkInputs


class ImplicitConfig(BaseModel):
    """The inputs and sizes of an `ImplicitNetwork`.

    Attributes
    ----------
    image
        Which image it sees, if any.
    touch
        Whether it is given touch charts and which of them touched.
    encoder_layers, encoder_kernel, encoder_norm, encoder_width
        The image encoder, as in `NetworkConfig`.
    features, blocks
        The decoder: features of each layer, and residual blocks of two layers.
    band
        Distances beyond this many m, on either side, count the same.
    spacing
        Of the grid that a reconstruction's mesh is made on, m.
    touch_reach
        Around what was felt, a reconstruction goes by it: m at which its weight has fallen to 1/e. 0 goes by the network alone.
    side
        Vertices along a side of a touch chart.
    centre, radius
        The ball that objects lie in, m, world. The network sees positions in units of the radius from the centre.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    image: ImageKind | None = None
    touch: bool = False
    encoder_layers: Literal[12, 15, 18, 25] = 12
    encoder_kernel: Literal[3, 5] = 5
    encoder_norm: Norm = "batch"
    encoder_width: float = Field(default=0.25, gt=0, le=64)
    features: int = Field(default=128, ge=2, le=2**12)
    blocks: int = Field(default=3, ge=0, le=100)
    band: float = Field(default=0.03, gt=0)
    spacing: float = Field(default=0.004, ge=1e-3)
    touch_reach: float = Field(default=0.01, ge=0, le=1)
    side: int = Field(default=9, ge=3, le=MOST_SIDE)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.6)
    radius: float = Field(default=0.25, gt=0)


IMPLICIT_CONFIGURATIONS: Mapping[str, ImplicitConfig] = {
    "implicit-touch": ImplicitConfig(touch=True),
    "implicit-occluded": ImplicitConfig(image="occluded"),
    "implicit-occluded-touch": ImplicitConfig(image="occluded", touch=True),
    "implicit-unoccluded": ImplicitConfig(image="unoccluded"),
    "implicit-unoccluded-touch": ImplicitConfig(image="unoccluded", touch=True),
}
"""The implicit networks by name: they are given what the supplement's of that name are given."""

EVERY_CONFIGURATION: Mapping[str, NetworkInputs] = {**CONFIGURATIONS, **IMPLICIT_CONFIGURATIONS}
"""The networks of both families by name."""
