"""The stage on modelled objects: rows as declared, one array from another, equal for any number of workers, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.dataset.object_rows import ObjectRows, sensor_of
from pipeline.errors import InvalidInput, StageError
from pipeline.formats.description_file import description_path
from pipeline.kernels.touch.sliding import QUANTITIES, measure_steps, slide_gel
from pipeline.store.directory import DataDirectory
from pipeline.tables.touch_tables import sequence_tables
from schemas.slides import SLIDES
from stages.registry import resolve
from stages.simulate_slides import SimulateSlides
from tests.stages.tiny_dataset import manifest, run_stage

SMALL = tuple(f"simulate-slides.{text}" for text in ("slides=3", "steps=8", "rate=4", "pixels=40"))
MARKERS = {"rows": 2, "cols": 3, "radius": 5e-4}


@pytest.fixture(scope="module")
def surfaces(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("slides")
    run_stage(folder, "sample-surfaces", manifest())
    return folder


def sensor_file(folder: Path, **entries: object) -> Path:
    """Write the file of a GelSight with other entries; one that is None is removed."""
    described = yaml.safe_load(description_path("sensor", "gelsight").read_text()) | {"name": "slid"} | entries
    path = folder / "slid.yaml"
    path.write_text(yaml.safe_dump({name: value for name, value in described.items() if value is not None}))
    return path


def rows_of(data: Path, *names: str) -> ObjectRows:
    return ObjectRows(data, [f"slide_{name}" for name in names], None)


def test_rows_follow_from_the_stored_depth_pose_and_friction(surfaces, tmp_path):
    worn = f"simulate-slides.sensor={sensor_file(tmp_path, markers=MARKERS)}"
    run_stage(surfaces, "simulate-slides", manifest(), *SMALL, worn)
    stored = [name for name in QUANTITIES if name != "traction"]
    rows = rows_of(surfaces, *stored, "shape", "scale", "friction", "time")
    sensor = sensor_of(rows.collections["slides"].first)
    assert sensor.markers.rows == 2
    drawn = []
    for object_id in rows.object_ids:
        values = {name: rows.read(f"slide_{name}", object_id) for name in (*stored, "shape", "scale", "friction", "time")}
        assert values["time"] == pytest.approx(np.tile(np.arange(8) / 4, (3, 1)))
        assert values["settled"].all()
        assert ((values["scale"] == 1) == (values["shape"] > 0)).all()
        assert values["marker_displacement"].shape == (3, 8, 6, 2)
        for slide, friction in enumerate(values["friction"]):
            assert 0.3 <= friction <= 1.2
            views = zip(values["depth"][slide], values["pose"][slide], strict=True)
            again = measure_steps(slide_gel(views, sensor, float(friction)), stored)
            for name in stored:
                assert (again[name] == values[name][slide]).all(), name
            pressure, force = values["pressure"][slide], values["force"][slide]
            assert -force[:, 2] == pytest.approx(pressure.sum(axis=(1, 2)) * np.prod(sensor.pitch), rel=1e-4)
            assert (np.hypot(*force[:, :2].T) <= friction * -force[:, 2] * 1.001).all()
            assert not force[[0, -1]].any()  # it begins and ends without contact
            assert force[3:5].any()
        assert (rows.read("slide_depth", object_id, 1) == values["depth"][1]).all()
        drawn.append(values["pose"])
    assert not np.array_equal(*drawn)


def test_only_what_is_asked_for_is_stored(surfaces):
    run_stage(surfaces, "simulate-slides", manifest(), *SMALL, "simulate-slides.store=[force, traction]")
    shard = DataDirectory(surfaces).collection(SLIDES).first
    assert {name for name in SLIDES.arrays if name.startswith("slide_") and shard.has(name)} == {
        *(f"slide_{name}" for name in ("time", "pose", "settled", "force", "traction", "shape", "scale", "friction", "untouched"))
    }
    rows = rows_of(surfaces, "force", "traction")
    pitch = np.prod(sensor_of(shard).pitch)
    for object_id in rows.object_ids:
        force, traction = (rows.read(name, object_id) for name in rows.arrays)
        np.testing.assert_allclose(traction.sum(axis=(2, 3)) * pitch, force[..., :2], atol=1e-4)


def test_summary_counts_slides_and_steps_by_class(surfaces):
    run_stage(surfaces, "simulate-slides", manifest(), *SMALL)
    rows = rows_of(surfaces, "gross_slip")
    (table,) = sequence_tables(surfaces)
    *classes, total = (row.cells for row in table.rows)
    assert [row[0] for row in classes] == sorted(set(rows.categories))
    count = len(rows.object_ids)
    assert total[1:5] == [count, 3 * count, 3 * 8 * count, 0]
    assert [sum(row[column] for row in classes) for column in range(1, 5)] == total[1:5]
    assert total[5] == pytest.approx(100 * np.mean([rows.read("slide_gross_slip", name) for name in rows.object_ids]))


def test_friction_of_the_sensor_is_taken_where_none_is_set(surfaces, tmp_path):
    gel = {"modulus": 2e5, "poisson": 0.48, "friction": 0.75}
    worn = f"simulate-slides.sensor={sensor_file(tmp_path, gel=gel)}"
    run_stage(surfaces, "simulate-slides", manifest(), *SMALL, worn, "simulate-slides.friction=null", "simulate-slides.store=[]")
    rows = rows_of(surfaces, "friction")
    assert all((rows.read("slide_friction", name) == 0.75).all() for name in rows.object_ids)


def test_steps_that_do_not_settle_are_counted(surfaces, monkeypatch):
    monkeypatch.setattr("pipeline.kernels.touch.friction.MAX_STEPS", 0)
    run_stage(surfaces, "simulate-slides", manifest(), *SMALL, "simulate-slides.store=[]", "simulate-slides.slides=1")
    shard = DataDirectory(surfaces).collection(SLIDES).first
    unsettled = (~shard.read("slide_settled")).sum()
    assert 0 < unsettled < 16
    (line,) = SimulateSlides().describe_shard(resolve("simulate-slides", "draft", []), shard)
    assert line.startswith(f"{unsettled} of 16 steps did not settle")


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("store=[force, shaer]", "unknown array shaer, did you mean shear?"),
        ("friction=[1.2, 0.3]", "the least comes first, then the greatest"),
        ("friction=[-0.1, 0.3]", "greater than or equal to 0"),
        ("slide_speed=[0, 0.3]", "greater than 0"),
        ("steps=3", "greater than or equal to 4"),
    ],
)
def test_unusable_settings_are_named(assignment, message):
    with pytest.raises(InvalidInput, match=message):
        resolve("simulate-slides", "standard", [f"simulate-slides.{assignment}"])


@pytest.mark.parametrize(
    ("entries", "assignments", "words"),
    [
        ({"gel": None}, [], "sensor slid has no elastic gel, which slides and lifts need"),
        ({}, ["friction=null"], "the friction of sensor slid is not known"),
        ({}, ["store=[marker_displacement]"], "store names marker_displacement, but slid has none"),
        ({}, ["depth=[0.001, 0.005]"], "0.005 m, the gel of slid is 0.004 m thick"),
        ({}, ["press_speed=[0.0001, 0.001]"], "a press of 0.0012 m at a press_speed of 0.0001 m/s takes 12.2 s, over a quarter of 8 steps"),
        ({}, ["slide_speed=[0.01, 0.08]"], "steps move by up to 0.02 m, more than the gel of slid is thick, 0.00504 m: lower press_speed"),
        ({}, ["twist_speed=[1, 9]"], "steps move by up to 0.0266 m"),
    ],
)
def test_gel_or_path_that_cannot_be_is_refused_before_the_run(surfaces, tmp_path, entries, assignments, words):
    worn = sensor_file(tmp_path, **entries)
    assert SimulateSlides().assets(resolve("simulate-slides", "draft", [f"simulate-slides.sensor={worn}"])) == [worn]
    with pytest.raises(StageError, match=words):
        run_stage(
            surfaces, "simulate-slides", manifest(), *SMALL, *(f"simulate-slides.{text}" for text in (f"sensor={worn}", *assignments))
        )
