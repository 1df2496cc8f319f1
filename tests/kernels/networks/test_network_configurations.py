"""Network configurations against the supplement's tables."""

import pytest
from pydantic import ValidationError
from torch import nn

from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS, SINGLE_IMAGE, NetworkConfig

NETWORKS = {**CONFIGURATIONS, "single-image": SINGLE_IMAGE}
# (name, image, touch, encoder, linear layer, graph network): parameters of Tables 6-11 in the specification's reading; "none" has no table.
PARAMETERS = [
    ("none", None, False, 0, 0, 725_003),
    ("touch", None, True, 0, 0, 817_753),
    ("occluded-touch", "occluded", True, 588_480, 0, 1_187_503),
    ("occluded", "occluded", False, 588_480, 0, 769_803),
    ("unoccluded-touch", "unoccluded", True, 588_480, 0, 971_003),
    ("unoccluded", "unoccluded", False, 491_040, 0, 1_191_253),
    ("single-image", "rendering", False, 3_537_248, 224_250, 1_507_503),
]


def parameters(module: nn.Module | None) -> int:
    return 0 if module is None else sum(parameter.numel() for parameter in module.parameters())


@pytest.mark.parametrize(("name", "image", "touch", "encoder", "linear", "gcn"), PARAMETERS)
def test_inputs_and_parameters(name: str, image: str | None, touch: bool, encoder: int, linear: int, gcn: int) -> None:
    config = NETWORKS[name]
    assert (config.image, config.touch) == (image, touch)
    network = DeformationNetwork(config)
    assert (parameters(network.encoder), parameters(network.linear), parameters(network.gcn)) == (encoder, linear, gcn)
    assert parameters(network) == encoder + linear + gcn


def test_graph_networks_of_the_tables() -> None:
    sizes = {name: (config.gcn_layers, config.gcn_features) for name, config in NETWORKS.items()}
    assert sizes == {
        "none": (20, 200),
        "touch": (15, 250),
        "occluded-touch": (20, 250),
        "occluded": (20, 200),
        "unoccluded-touch": (25, 200),
        "unoccluded": (20, 250),
        "single-image": (25, 250),
    }


@pytest.mark.parametrize(
    "wrong",
    [
        {"encoder_layers": 13},
        {"encoder_kernel": 4},
        {"encoder_width": 0},
        {"gcn_layers": 1},
        {"side": 2},
        {"radius": 0},
        {"mixed": 1.1},
        {"layers": 3},
    ],
)
def test_invalid_configurations_are_rejected(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        NetworkConfig.model_validate(wrong)
