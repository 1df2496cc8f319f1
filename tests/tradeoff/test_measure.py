"""Trades measured for real on a few toy objects, and samples that represent all objects within a time limit."""

import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.manifest import load_manifest
from pipeline.config.sources import Object
from pipeline.console import console
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import InvalidInput, StoreError
from pipeline.formats.description_file import description_path
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.tactile_image import untouched_image
from pipeline.store.directory import DataDirectory
from pipeline.tradeoff.end_to_end import NETWORK, coarse_sensor
from pipeline.tradeoff.measure import FEWEST, MOST, Setup, candidates, forecast, measure_trade, stage_key, stages_before, stratified
from pipeline.tradeoff.trades import FOLDER, MeasuredTrade, read_trade, trade_path
from schemas.surfaces import SURFACES
from stages.registry import TRADED, load_trade
from stages.simulate_grasps.stage import sensors_of_grasps
from tests.stages import ball_dataset

STAGE = "sample-surfaces"
FAST = "sample-surfaces.directions=16"
"""A sixteenth of the default's rays."""
LATER = np.inf


def setup(data: Path, seed: int = 0, **changes: object) -> Setup:
    toy = load_manifest("toy")
    sample = {"objects": stratified(toy.objects(None), 2, seed), "assignments": (FAST,)}
    return Setup(**{"data": data, "manifest": "toy", "seed": 0, "preset": "draft", **sample, **changes})


def measure(one: Setup, deadline: float = LATER) -> MeasuredTrade:
    return measure_trade(STAGE, one, limit=1e9, deadline=deadline, console=console)


@pytest.fixture(scope="module")
def measured_data(tmp_path_factory) -> Path:
    data = tmp_path_factory.mktemp("trade")
    measure(setup(data))
    return data


def test_time_that_is_too_short_for_any_candidate_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"sample-surfaces: every candidate takes longer than there is time for.*; give more --minutes"):
        measure_trade(STAGE, setup(tmp_path), limit=0, deadline=LATER, console=console)


def test_another_sample_may_share_no_object_with_the_first(tmp_path: Path) -> None:
    items = load_manifest("toy").objects(None)
    for objects in (items[:1], items[1:2]):
        sample = setup(tmp_path, objects=objects, assignments=(FAST, "simulate-grasps.attempts=5"))
        measure_trade("simulate-grasps", sample, limit=1e9, deadline=0, console=console)
    (inputs,) = (tmp_path / FOLDER).glob("inputs-*")
    assert list(DataDirectory(inputs).collection(SURFACES)) == [items[1].object_id]


def test_more_points_take_more_bytes_and_cover_better(measured_data: Path) -> None:
    points = sorted(
        (one for one in measure(setup(measured_data)).points if one.changes.keys() <= {"points"}),
        key=lambda one: one.changes.get("points", 10_000),
    )
    assert [one.label for one in points] == ["points=2500", "points=5000", "draft, standard, paper", "points=20000"]
    for value in ("error", "kilobytes"):
        values = [getattr(one, value) for one in points]
        assert values == sorted(values, reverse=value == "error")
    coarse, fine = points[0].error, points[3].error
    assert coarse / fine == pytest.approx(np.sqrt(8), rel=0.15)  # the distance to the nearest of n points falls as 1/√n


def test_repeated_measurement_runs_no_stage(measured_data: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in measured_data.rglob("*")}
    measure(setup(measured_data))
    assert {path: path.stat().st_mtime_ns for path in measured_data.rglob("*")} == before
    assert not (measured_data / "tradeoff" / STAGE).exists()  # what candidates made is removed


def test_interrupted_and_resumed_measurement_gives_the_same_errors(measured_data: Path, tmp_path: Path) -> None:
    assert len(measure(setup(tmp_path), deadline=time.monotonic()).points) == 1
    whole = measure(setup(measured_data))
    part = whole.model_copy(update={"points": whole.points[:2]})  # as a killed run leaves it
    part.write(tmp_path)
    (tmp_path / "tradeoff" / STAGE / "points=2500" / "surfaces").mkdir(parents=True)
    continued = measure(setup(tmp_path))
    assert [(one.label, one.errors) for one in continued.points] == [(one.label, one.errors) for one in whole.points]
    assert continued.points[:2] == whole.points[:2]


def test_other_settings_are_measured_again(measured_data: Path) -> None:
    own = setup(measured_data)
    assert stage_key(STAGE, own) == stage_key(STAGE, replace(own, objects=()))
    for other in (
        setup(measured_data, assignments=(FAST, "sample-surfaces.diagonal=0.3")),
        setup(measured_data, assignments=("directions=64",)),
    ):
        assert stage_key(STAGE, other) != stage_key(STAGE, own)
    hands = [
        stage_key("render-vision", setup(measured_data, assignments=(f"simulate-grasps.hand={hand}",)))
        for hand in ("allegro_right", "allegro_left")
    ]
    assert hands[0] != hands[1]


def test_key_changes_with_the_content_of_the_sensor_file(tmp_path: Path) -> None:
    described = description_path("sensor", "gel_16mm").read_text()
    (file := tmp_path / "gel.yaml").write_text(described)
    own = setup(tmp_path, assignments=(f"simulate-grasps.sensor={file}",), network=NETWORK)
    before = stage_key("evaluate", own)
    assert stage_key("evaluate", own) == before
    file.write_text(described.replace("rows: 100", "rows: 50"))
    assert stage_key("evaluate", own) != before


@pytest.mark.parametrize("stage", TRADED)
def test_candidates_are_allowed_and_differ(stage: str, tmp_path: Path) -> None:
    one, declared = setup(tmp_path), load_trade(stage)
    listed = candidates(stage, one)
    assert declared is not None
    assert len(listed) > len(declared.candidates)
    assert len({str(settings.results()) for settings, _ in listed.values()}) == len(listed)
    assert one.settings(stage, declared.reference).results()
    seconds, skipped = forecast(stage, one, 1e9)
    assert seconds > 0
    assert not skipped


def test_candidates_that_conflict_with_the_settings_are_skipped(tmp_path):
    labels = candidates("simulate-grasps", setup(tmp_path, assignments=("simulate-grasps.grasps=50",)))
    assert "ik_samples=256" in labels
    assert "attempts=10" not in labels  # they yield 40 grasps at most


def test_stages_before_are_those_whose_outputs_are_read(tmp_path: Path) -> None:
    one = setup(tmp_path)
    assert stages_before("sample-surfaces", one) == []
    assert stages_before("train-gcn", one) == ["sample-surfaces", "simulate-grasps", "simulate-touch", "train-unet", "fit-charts"]
    assert "train-unet" not in stages_before("train-gcn", setup(tmp_path, assignments=("fit-charts.cloud=true",)))


def test_stage_without_a_trade_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="unknown stage evaluate; choose from sample-surfaces"):
        measure_trade("evaluate", setup(tmp_path), limit=1, deadline=LATER, console=console)


def test_sample_without_an_error_is_reported(tmp_path: Path, monkeypatch) -> None:
    declared = replace(load_trade(STAGE), errors=lambda data, reference: {})
    monkeypatch.setattr("pipeline.tradeoff.measure.load_trade", lambda stage: declared)
    with pytest.raises(StoreError, match="sample-surfaces, draft, standard, paper: no object of the sample has this error"):
        measure(setup(tmp_path))
    assert not trade_path(tmp_path, STAGE).exists()


def test_points_limited_by_an_earlier_request_are_listed_again(measured_data: Path, tmp_path: Path) -> None:
    whole = measure(setup(measured_data))
    whole.model_copy(update={"total": 1}).write(tmp_path)
    assert measure(setup(tmp_path)).total == whole.total == len(whole.points)


def test_number_of_trials_is_counted_in_the_dataset_and_stored(tmp_path: Path, monkeypatch) -> None:
    declared = replace(load_trade(STAGE), trials=lambda data: len(ObjectRows(data, ("points",), split=None)))
    monkeypatch.setattr("pipeline.tradeoff.measure.load_trade", lambda stage: declared)
    assert measure(setup(tmp_path), deadline=time.monotonic()).trials == 3
    assert read_trade(tmp_path, STAGE).trials == 3


def test_sensors_that_may_touch_are_those_of_all_grasps(tmp_path: Path) -> None:
    ball_dataset.make_data(tmp_path, 1)
    assert sensors_of_grasps(tmp_path) == ball_dataset.GRASPS_AN_OBJECT * ball_dataset.SENSORS


def test_file_of_a_trade_lies_below_the_data_directory(measured_data: Path) -> None:
    assert trade_path(measured_data, STAGE) == measured_data / "tradeoff" / "sample-surfaces.json"


def test_coarser_sensor_keeps_its_photograph(tmp_path: Path) -> None:
    fine = load_sensor("gelsight", shape=(30, 40))
    calibrated = fine.calibrated
    assert calibrated is not None
    optics = calibrated.model_copy(update={"background": "elsewhere.png"})
    seen = fine.model_copy(update={"photograph": untouched_image(fine).tobytes(), "calibrated": optics})
    coarse = load_sensor(coarse_sensor(seen, 0.5, tmp_path))
    assert (coarse.shape, coarse.name) == ((15, 20), "gelsight_coarse")
    assert np.abs(untouched_image(coarse).astype(int) - untouched_image(load_sensor("gelsight", shape=(15, 20)))).max() <= 3


def test_objects_with_the_same_names_and_other_sources_are_another_sample(tmp_path: Path) -> None:
    one = setup(tmp_path)
    other = replace(one, objects=[replace(item, source={**item.source, "seed": 5}) for item in one.objects])
    assert other.sample != one.sample


OBJECTS = [Object(f"{kind}-{split}-{number:02d}", kind, {}, split) for kind in "abc" for split in ("train", "test") for number in range(20)]


@pytest.mark.parametrize("count", [6, 12, 30])
def test_every_split_and_category_has_its_share(count: int) -> None:
    found = Counter((item.split, item.category) for item in stratified(OBJECTS, count, seed=0))
    assert sum(found.values()) == count
    assert set(found.values()) == {count // 6}


def test_sample_follows_from_the_seed() -> None:
    assert stratified(OBJECTS, 12, seed=1) == stratified(OBJECTS, 12, seed=1)
    assert stratified(OBJECTS, 12, seed=1) != stratified(OBJECTS, 12, seed=2)


def test_sample_contains_files_of_all_sizes(tmp_path: Path) -> None:
    objects = []
    for size in range(40):
        (path := tmp_path / f"{size}.obj").write_bytes(b"#" * size)
        objects.append(Object(f"object-{39 - size:02d}", "", {"file": path}, "train"))
    sizes = sorted(item.source["file"].stat().st_size for item in stratified(objects, 4, seed=0))
    assert [size // 10 for size in sizes] == [0, 1, 2, 3]


def test_sample_of_a_small_manifest_is_complete_and_contains_rare_splits() -> None:
    assert stratified(OBJECTS[:3], 4, seed=0) == OBJECTS[:3]
    lonely = [*OBJECTS[:20], Object("alone", "a", {}, "valid")]
    assert "alone" in {item.object_id for item in stratified(lonely, 4, seed=0)}


@pytest.mark.parametrize(("seconds", "count"), [(0, FEWEST), (10, 10), (1000, MOST)])
def test_sample_stays_within_the_time_limit(seconds: float, count: int) -> None:
    objects = [Object(f"{number:02d}", "", {}, "train") for number in range(60)]
    setup = Setup(Path(), "many", objects, 0, "draft")
    assert len(setup.affordable(seconds, lambda sample: float(len(sample.objects))).objects) == count
