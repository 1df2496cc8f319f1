"""Of several pretrained networks, the one that has learned from objects as large as the given one reconstructs it."""

from pathlib import Path
from typing import Any

import pytest

import vt_pipeline as vt_library
from pipeline.errors import InvalidInput, StageError, StoreError
from pipeline.models.shipped_weights import shipped_network
from pipeline.reconstruct.observation_checks import find_box
from pipeline.reconstruct.observation_file import RobotObservation
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict
from tests.command_line import vt
from tests.reconstruct.robot import write_files, write_observation
from tests.stages import ball_dataset as spheres

SMALL, LARGE = "implicit-gels: trained with objects of 0.1 to 0.36 m", "implicit-any: trained with objects of 0.5 m"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make balls with diagonals of 0.35, 0.42, 0.48 and 0.55 m, and a folder of networks beside them."""
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 4)
    for name, diagonals in (("implicit-any", None), ("implicit-gels", (0.1, 0.36))):
        spheres.make_implicit_model(folder / "networks", name, diagonals, spacing=0.05)
    return folder


@pytest.fixture(autouse=True)
def shipped(data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = data / "networks" / "models"
    for module in ("pipeline.models.shipped_weights", "pipeline.reconstruct.predict"):
        monkeypatch.setattr(f"{module}.SHIPPED", folder)
    return folder


def seen(folder: Path, **entries: Any) -> Path:
    """Write the observation of a ball with a diagonal of 0.208 m, which a camera sees; `entries` replace others."""
    written = write_files(folder)
    return write_observation(folder, {"object": written["object"], "camera": written["camera"]} | entries)


@pytest.mark.parametrize(
    ("diagonal", "name"),
    [
        (0.02, "implicit-gels"),
        (0.1, "implicit-gels"),
        (0.42, "implicit-gels"),
        (0.43, "implicit-any"),
        (5, "implicit-any"),
        (None, "implicit-any"),
    ],
)
def test_network_is_that_whose_objects_differ_least_in_ratio(diagonal: float | None, name: str) -> None:
    assert shipped_network(diagonal) == name  # 0.42 = 0.36 · 1.17 = 0.5 / 1.19


def test_objects_of_a_dataset_are_given_to_the_network_for_their_size(data: Path, tmp_path: Path) -> None:
    for object_id, remark in (("a", SMALL), ("d", LARGE)):
        prediction = predict(tmp_path / "out.ply", StoredGrasps(data, object_id))
        assert prediction.remarks[0] == remark
        assert prediction.remarks[-1].startswith(f"{remark.partition(':')[0]}, over all combinations of inputs")
    with pytest.raises(StoreError, match="has no object e; it has a, b, c, d"):
        predict(tmp_path / "out.ply", StoredGrasps(data, "e"))


def test_a_named_network_is_taken_whatever_the_size(data: Path, tmp_path: Path) -> None:
    named = predict(tmp_path / "out.ply", StoredGrasps(data, "a"), PredictOptions(configuration="implicit-any"))
    assert named.remarks[-1].startswith("implicit-any, over all")
    assert LARGE not in named.remarks
    assert PredictOptions(configuration="implicit-gels-touch").network(StoredGrasps(data, "d"))[1] == "implicit-gels-touch"
    with pytest.raises(StageError, match="has no model implicit-touch: its models are implicit-any, implicit-gels"):
        predict(tmp_path / "out.ply", StoredGrasps(data, "a"), PredictOptions(configuration="implicit-touch"))


def test_the_size_of_an_observed_object_is_as_stated_or_seen(tmp_path: Path) -> None:
    stated, camera = seen(tmp_path), write_files(tmp_path)["camera"]
    assert PredictOptions().network(stated)[1] == "implicit-gels"
    assert PredictOptions().network(RobotObservation(object={"centre": (0, 0, 0), "diagonal": 0.5}))[1] == "implicit-any"
    by_depth = seen(tmp_path, object={}, camera=camera | {"depth": "depth.npy"})
    box = find_box(by_depth)
    assert box is not None
    assert box.diagonal == pytest.approx(0.18, rel=0.1)  # of the ball's visible part, and as much behind
    assert PredictOptions().network(by_depth)[1] == "implicit-gels"
    assert PredictOptions().network(seen(tmp_path, object={"centre": [0.4, -0.1, 0.2]}))[1] == "implicit-gels"  # by the mask


def test_check_and_predict_choose_the_same_network_and_name_it(tmp_path: Path) -> None:
    path = seen(tmp_path)
    assert "with model implicit-gels, trained with objects of 0.1 to 0.36 m:" in vt("check", path, "--picture", tmp_path / "a.png")
    assert SMALL in vt("predict", tmp_path / "out.ply", "--observation", path)
    assert vt_library.reconstruct(path, resolution=64).remarks[0] == SMALL


def test_an_object_of_unknown_size_is_given_to_the_network_for_large_ones_and_that_is_said(tmp_path: Path) -> None:
    camera = write_files(tmp_path)["camera"]
    del camera["mask"]
    path = seen(tmp_path, object={"centre": [0.4, -0.1, 0.2]}, camera=camera)
    remarks = predict(tmp_path / "out.ply", path).remarks
    assert remarks[0] == f"{LARGE}; taken as the object's size is not known: state object.diagonal"
    assert "with model implicit-any, trained with objects of 0.5 m:" in vt("check", path, "--picture", tmp_path / "a.png")


@pytest.mark.parametrize(
    ("entries", "fault"),
    [
        ({"object": {"centre": [0.4, -0.1, 0.2], "diagonal": "x"}}, "object.diagonal"),
        ({"object": {"centre": [400, -100, 200], "diagonal": 0.2}}, "write unit: mm"),
        ({"camera": None, "object": {}}, "needs a photograph or touches"),
    ],
)
def test_faults_are_named_whatever_they_hide_of_the_size(tmp_path: Path, entries: dict[str, Any], fault: str) -> None:
    with pytest.raises(InvalidInput, match=fault):
        predict(tmp_path / "out.ply", seen(tmp_path, **entries))
