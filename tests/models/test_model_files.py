"""Saved networks load unchanged; invalid files give a clear error before memory is allocated."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from pydantic import BaseModel

from pipeline.errors import StoreError
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.models.model_files import load_network, read_description, save_model
from pipeline.models.reconstruction import DeformationReconstructor
from pipeline.models.touch_model import load_touch_model, save_touch_model
from tests.stages import ball_dataset as spheres


class Width(BaseModel):
    width: int


def module() -> torch.nn.Module:
    return torch.nn.Sequential(torch.nn.Linear(2, 3), torch.nn.BatchNorm1d(3))


def test_saved_network_is_loaded_unchanged(tmp_path: Path) -> None:
    saved = module()
    save_model(tmp_path, saved, Width(width=8))
    loaded = load_network(tmp_path, module, "cpu")
    assert all(torch.equal(value, loaded.state_dict()[name]) for name, value in saved.state_dict().items())
    assert not loaded.training
    assert read_description(tmp_path, Width) == Width(width=8)
    with pytest.raises(StoreError, match="no trained model"):
        load_network(tmp_path / "nowhere", module, "cpu")
    with pytest.raises(StoreError, match="no trained model"):
        read_description(tmp_path / "nowhere", Width)


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:-1],
        lambda content: b"\xff" * 8 + content[8:],
        lambda content: content.replace(b'"F32"', b'"F31"', 1),
        lambda content: content.replace(b"[3,2]", b"[3,9]", 1),
        lambda content: content.replace(b"{", b"[", 1),
    ],
    ids=["empty", "cut", "header", "dtype", "shape", "json"],
)
def test_unreadable_weights_are_errors(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    save_model(tmp_path, module(), Width(width=8))
    weights = tmp_path / "model.safetensors"
    weights.write_bytes(damage(weights.read_bytes()))
    with pytest.raises(StoreError, match=r"no trained model that can be used \(model.safetensors"):
        load_network(tmp_path, module, "cpu")


@pytest.fixture
def unet(tmp_path: Path) -> Path:
    save_touch_model(tmp_path, UNet(1), sensor=spheres.SENSOR, untouched=untouched_image(spheres.SENSOR), mask_threshold=1e-3)
    return tmp_path


@pytest.fixture(scope="module")
def gcn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return spheres.make_model(tmp_path_factory.mktemp("gcn"), "occluded-touch")


def change(folder: Path, **changes: Any) -> None:
    path = folder / "model.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"width": 10**9}, "width: .* less than or equal to 4096"),
        ({"width": 4096}, r"arrays of model.safetensors differ .* first: \(16, 8, 2, 2\)|first: .*, not .*4096"),
        ({"width": None}, "width: "),
        ({"mask_threshold": "x"}, "mask_threshold: "),
        ({"mask_threshold": -1}, "mask_threshold: .* greater than or equal to 0"),
        ({"mask_threshold": 10**30}, "mask_threshold: .* less than or equal to 3"),
        ({"sensor": {}}, "sensor.name is missing"),
        ({"more": 1}, "no entry more"),
    ],
)
def test_touch_models_with_another_description_are_errors(unet: Path, changes: dict[str, Any], words: str) -> None:
    change(unet, **changes)
    with pytest.raises(StoreError, match=words):
        load_touch_model(unet, "cpu")


@pytest.mark.parametrize(
    "content", [b"", b"[]", b"[" * 100_000, b'{"width": NaN}', b"\xff"], ids=["empty", "list", "nested", "nan", "bytes"]
)
def test_invalid_descriptions_are_errors(unet: Path, content: bytes) -> None:
    (unet / "model.json").write_bytes(content)
    with pytest.raises(StoreError, match="no trained model that can be used"):
        load_touch_model(unet, "cpu")


def test_invalid_untouched_image_is_an_error(unet: Path) -> None:
    Image.fromarray(np.zeros((4, 5, 3), np.uint8)).save(unet / "untouched.png")
    with pytest.raises(StoreError, match=r"untouched.png has \(4, 5\) pixels, its sensor \(100, 100\)"):
        load_touch_model(unet, "cpu")
    (unet / "untouched.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0")
    with pytest.raises(StoreError, match=r"untouched\.png"):
        load_touch_model(unet, "cpu")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"network": {"gcn_layers": 10**9}}, "network.gcn_layers: .* less than or equal"),
        ({"network": {"gcn_features": 10**9}}, "network.gcn_features: .* less than or equal"),
        ({"network": {"gcn_features": 2**16, "image": "occluded", "touch": True}}, "differ from model.json"),
        ({"network": {"side": 10**9, "touch": True}}, "network.side: .* less than or equal"),
        ({"network": {"passes": 10**9}}, "network.passes: .* less than or equal"),
        ({"camera": None}, "a network with an image has camera and resolution"),
        ({"camera": [[1, 0, 0, 0]]}, "camera"),
        ({"resolution": [256]}, "resolution"),
        ({"charts": None}, "one with touch charts has charts"),
    ],
)
def test_deformation_networks_with_another_description_are_errors(gcn: Path, tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    for name in ("model.json", "model.safetensors"):
        (tmp_path / name).write_bytes((gcn / name).read_bytes())
    change(tmp_path, **changes)
    with pytest.raises(StoreError, match=words):
        DeformationReconstructor(tmp_path)
