"""The note of `predict` about the error of its network."""

import math
import re

import pytest

from pipeline.errors import StoreError
from pipeline.models.shipped_weights import SHIPPED, Error, read_card
from pipeline.reconstruct.network_error import error_note
from pipeline.reconstruct.predict import PredictOptions
from pipeline.store.directory import DataDirectory
from tests.command_line import vt
from tests.stages import ball_dataset as spheres

SPLITS = ("train", "test", "test")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 3, SPLITS)  # balls of radius 100, 120, 140 mm
    spheres.make_model(folder, "none", still=True)  # predicts a ball of 250 mm for every object
    spheres.make_model(folder, "touch")
    spheres.make_implicit_model(folder, "implicit-any")
    return folder


def note_of(data, name: str) -> str:
    return error_note(PredictOptions(data / "models", name).reader())


def test_note_of_an_unevaluated_network_shows_its_validation_loss(data):
    assert f"none: {1e3 * math.sqrt(2.5 / 9000 / 2):.1f} mm" in note_of(data, "none")  # each way counts
    by_training = note_of(data, "implicit-any-touch")
    assert (
        "implicit-any, over all combinations of inputs: signed distances near validation objects, scaled to 0.5 m, are wrong by 75"
        in by_training
    )
    assert "`evaluate` compares it" in note_of(data, "none")


@pytest.mark.parametrize("facts", [{}, {"best": None}, {"best": {"loss": "small"}}])
def test_record_without_a_validation_loss_gives_a_clear_error(data, monkeypatch, facts):
    reader = PredictOptions(data / "models", "none").reader()
    record = DataDirectory(data / "models").folder("gcn/none").model_copy(update={"facts": facts})
    monkeypatch.setattr(DataDirectory, "folder", lambda *_: record)
    with pytest.raises(StoreError, match=r"none.json: it lacks the validation loss of a training; delete it and train the model again"):
        error_note(reader)


def test_predict_warns_of_a_network_worse_than_looking_up_a_training_object(data, tmp_path):
    spheres.run_stage(data, "evaluate", spheres.objects(3, SPLITS), "points=500", "configurations=[none]")
    output = vt("predict", tmp_path / "ball.ply", "--data", data, "--object", "b", "--configuration", "none")
    warning = re.search(
        r"worse than looking up: none: (\S+) mm from .* 2 test objects .* typical training object in its place: (\S+) mm", output
    )
    assert warning, output
    radius = (120 + 140) / 2  # mm; the network's sphere stays around the box of each ball
    ours, theirs = map(float, warning.groups())
    assert ours == pytest.approx((3**0.5 - 1) * radius, rel=0.1)  # of facets and points
    assert theirs < 15  # another ball, scaled to this one's size, but for the distance between points
    assert "`evaluate` compares it" in note_of(data, "touch")  # it was not evaluated


def test_note_of_a_shipped_network_shows_the_error_of_its_card():
    errors = read_card("implicit-any").errors["implicit-any-touch"]["all"]
    note = error_note(PredictOptions(SHIPPED, "implicit-any-touch").reader())
    assert f"implicit-any-touch: {1e3 * math.sqrt(errors.mean / 9000 / 2):.0f} mm" in note


def test_error_is_that_of_test_objects_about_as_large(data):
    """Balls in the test split have diagonals of 0.42 and 0.48 m."""
    spheres.run_stage(data, "evaluate", spheres.objects(3, SPLITS), "points=500", "configurations=[none]")
    reader = PredictOptions(data / "models", "none").reader()
    assert "2 test objects of 0.42 to 0.48 m" in error_note(reader, 0.45)
    assert "1 test object of 0.42 m" in error_note(reader, 0.35)
    far = error_note(reader, 0.12)
    assert "none: not measured on objects of 0.12 m; " in far
    assert "2 test objects of 0.42 to 0.48 m" in far


def test_card_gives_the_error_of_the_size_class_of_an_object():
    card = read_card("implicit-any")
    sized = Error(objects=7, mean=50, median=40, mm=4.25, diagonals=(0.1, 0.19))
    row = "implicit-any-touch"
    smaller = sized.model_copy(update={"diagonals": (0.06, 0.098)})
    with_sizes = card.model_copy(update={"errors": {row: card.errors[row] | {"0.03 to 0.1 m": smaller, "0.1 to 0.2 m": sized}}})
    assert with_sizes.error_of(row, 0.12) is sized  # the others are like it too, but less
    assert with_sizes.error_of(row, 0.05) is smaller
    assert with_sizes.error_of(row, 0.5) is card.errors[row]["all"]
    assert with_sizes.error_of(row, 0.03) is None
    assert with_sizes.error_of(row, None) is card.errors[row]["all"]  # whatever sizes it was measured on
    assert card.error_of("another", None) is None


def test_note_of_a_shipped_network_says_that_it_was_not_measured_at_a_hands_size():
    note = error_note(PredictOptions(SHIPPED, "implicit-any-touch").reader(), 0.12)
    assert note.startswith("implicit-any-touch: not measured on objects of 0.12 m; ")
    assert "objects of 0.5 m that it has not seen" in note
