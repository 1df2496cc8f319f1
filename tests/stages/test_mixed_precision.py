"""Trainings in mixed precision: layers are computed in bfloat16, points are not, and what is learned is nearly the same."""

from pathlib import Path

import pytest

from pipeline.models.families import model_name
from pipeline.store.directory import DataDirectory
from tests.stages import ball_dataset as spheres

SPLITS = ("train", "valid", "test")
OBJECTS = spheres.objects(3, SPLITS)
SETTINGS = {
    "train-implicit": ("configuration=implicit-any", "features=16", "blocks=1", "queries=50", "encoder_width=0.125"),
    "train-gcn": ("configuration=unoccluded-touch", "gcn_layers=3", "gcn_features=12", "loss_points=200", "encoder_width=0.125"),
}


def best(data: Path, stage: str, precision: str) -> float:
    """Train for two epochs; the validation loss."""
    stated = (*SETTINGS[stage], "epochs=2", "samples_per_object=6", f"precision={precision}", "accelerator=cpu")
    spheres.run_stage(data, stage, OBJECTS, *stated)
    configuration = SETTINGS[stage][0].removeprefix("configuration=")
    return float(DataDirectory(data).folder(model_name(configuration)).facts["best"]["loss"])


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 3, SPLITS)
    return folder


@pytest.mark.parametrize("stage", SETTINGS)
def test_mixed_precision_reaches_the_loss_of_full_precision(data, stage):
    full, mixed = (best(data, stage, precision) for precision in ("32-true", "bf16-mixed"))
    assert mixed != full
    assert mixed == pytest.approx(full, rel=0.1)
