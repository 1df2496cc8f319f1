"""Implicit networks as data: the inputs and the size of each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from pipeline.kernels.networks.network_configurations import NetworkInputs


class ImplicitConfig(NetworkInputs):
    """The inputs and sizes of an `ImplicitNetwork`.

    Attributes
    ----------
    features, blocks
        The decoder: features of each layer, and residual blocks of two layers.
    band
        Distances beyond this many m, on either side, count the same.
    spacing
        Of the grid that a reconstruction's mesh is made on, m.
    touch_reach
        Around what was felt, a reconstruction goes by it: m at which its weight has fallen to 1/e. 0 goes by the network alone.
    """

    encoder_layers: Literal[12, 15, 18, 25] = 12
    encoder_kernel: Literal[3, 5] = 5
    encoder_width: float = Field(default=0.25, gt=0, le=64)
    features: int = Field(default=128, ge=2, le=2**12)
    blocks: int = Field(default=3, ge=0, le=100)
    band: float = Field(default=0.03, gt=0)
    spacing: float = Field(default=0.004, ge=1e-3)
    touch_reach: float = Field(default=0.01, ge=0, le=1)


IMPLICIT_CONFIGURATIONS: Mapping[str, ImplicitConfig] = {
    "implicit-touch": ImplicitConfig(touch=True),
    "implicit-occluded": ImplicitConfig(image="occluded"),
    "implicit-occluded-touch": ImplicitConfig(image="occluded", touch=True),
    "implicit-unoccluded": ImplicitConfig(image="unoccluded"),
    "implicit-unoccluded-touch": ImplicitConfig(image="unoccluded", touch=True),
}
"""The implicit networks by name: they are given what the supplement's of that name are given."""
