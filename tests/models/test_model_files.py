"""Saved networks come back as they were."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from pipeline.errors import StoreError
from pipeline.models.model_files import load_model, save_model


def test_saved_network_is_loaded_as_it_was(tmp_path: Path) -> None:
    module = torch.nn.Sequential(torch.nn.Linear(2, 3), torch.nn.BatchNorm1d(3))
    save_model(tmp_path, module, {"width": 8})
    weights, description = load_model(tmp_path)
    assert all(torch.equal(value, weights[name]) for name, value in module.state_dict().items())
    assert description == {"width": 8}


def test_folder_without_a_network_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no trained model"):
        load_model(tmp_path / "nowhere")
