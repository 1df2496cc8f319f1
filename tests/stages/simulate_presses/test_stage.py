"""The stage on modelled objects: rows as declared, one array from another, equal for any number of pressed objects."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.dataset.object_rows import ObjectRows, sensor_of
from pipeline.errors import InvalidInput, StageError
from pipeline.formats.description_file import description_path
from pipeline.kernels.touch.depth_maps import impression, press_gel, scaled_gel
from pipeline.kernels.touch.tactile_image import render_gel
from stages.pressing_stage import pressed_sensor
from stages.registry import resolve
from stages.simulate_presses import SimulatePresses
from tests.stages.tiny_dataset import manifest, run_stage

ARRAYS = ["press_shape", "press_depth", "press_indentation", "press_contact", "press_image"]
SMALL = ("simulate-presses.presses=8", "simulate-presses.pixels=48")
SENSOR = "simulate-presses.sensor={}"


@pytest.fixture(scope="module")
def surfaces(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("presses")
    run_stage(folder, "sample-surfaces", manifest())
    return folder


def elastic_sensor(folder: Path) -> Path:
    path = folder / "soft.yaml"
    path.write_text(description_path("sensor", "gel_16mm").read_text().replace("name: gel_16mm", "name: soft") + "gel: {modulus: 1.0e5}\n")
    return path


def membrane_sensor(folder: Path) -> Path:
    described = yaml.safe_load(description_path("sensor", "gelsight").read_text())
    del described["gel"]
    path = folder / "drawn_in.yaml"
    path.write_text(yaml.safe_dump(described | {"name": "drawn_in", "membrane": 0.0009}))
    return path


def test_rows_follow_from_the_stored_depth(surfaces, tmp_path):
    worn = SENSOR.format(membrane_sensor(tmp_path))
    run_stage(surfaces, "simulate-presses", manifest(), *SMALL, worn, "simulate-presses.patches=0.5")
    rows = ObjectRows(surfaces, [*ARRAYS, "press_untouched"], None)
    sensor = sensor_of(rows.collections["presses"].first)
    assert sensor.shape == (36, 48)
    assert rows.read("press_untouched", rows.object_ids[0]).shape == (36, 48, 3)
    drawn = []
    for name in rows.object_ids:
        shape, depth, indentation, contact, image = (rows.read(array, name) for array in ARRAYS)
        drawn.append(depth)
        assert (shape == 0).any()  # patches of the object
        assert (shape > 0).any()
        for one in range(8):
            gel = press_gel(depth[one], sensor)
            assert (gel.contact == contact[one]).all()
            np.testing.assert_array_equal(gel.indentation.astype(np.float32), indentation[one])
            assert (render_gel(gel.indentation, sensor) == image[one]).all()
            assert 1e-4 - 1e-8 <= impression(depth[one], sensor).max() <= 1.2e-3 + 1e-8
            assert (rows.read("press_image", name, one) == image[one]).all()
    assert not np.array_equal(*drawn)
    with pytest.raises(Exception, match="press_force"):
        ObjectRows(surfaces, ["press_force"], None)


def test_elastic_gel_is_stored_with_pressure_and_force(surfaces, tmp_path):
    soft = SENSOR.format(elastic_sensor(tmp_path))
    run_stage(surfaces, "simulate-presses", manifest(), *SMALL, soft, "simulate-presses.patches=0")
    rows = ObjectRows(surfaces, [*ARRAYS, "press_pressure", "press_force"], None)
    sensor = sensor_of(rows.collections["presses"].first)
    for name in rows.object_ids:
        pressure, force = rows.read("press_pressure", name), rows.read("press_force", name)
        np.testing.assert_allclose(force, pressure.sum(axis=(1, 2)) * np.prod(sensor.pitch), rtol=1e-5)
        assert (force > 0).all()
        assert ((pressure > 0) == rows.read("press_contact", name)).all()


def test_range_of_gel_factors_is_drawn_per_press(surfaces):
    run_stage(surfaces, "simulate-presses", manifest(), *SMALL, "simulate-presses.gel=[0.3, 3]", "simulate-presses.patches=0")
    rows = ObjectRows(surfaces, ARRAYS, None)
    sensor = sensor_of(rows.collections["presses"].first)
    name = rows.object_ids[0]
    wider = [
        indentation.sum() - press_gel(depth, sensor).indentation.sum()
        for depth, indentation in zip(rows.read("press_depth", name), rows.read("press_indentation", name), strict=True)
    ]
    assert min(wider) < 0 < max(wider)


def test_gel_factor_widens_the_membrane_or_thickens_the_elastic_gel(tmp_path):
    settings = resolve("simulate-presses", "standard", [SENSOR.format(membrane_sensor(tmp_path))])
    assert scaled_gel(pressed_sensor(settings), 2.0).membrane == pytest.approx(0.0018)
    soft = pressed_sensor(resolve("simulate-presses", "standard", [SENSOR.format(elastic_sensor(tmp_path))]))
    assert scaled_gel(soft, 0.5).gel.thickness == pytest.approx(0.0034)


def test_pixels_are_square_and_null_keeps_the_cameras():
    by_pixels = {pixels: pressed_sensor(resolve("simulate-presses", "standard", [f"pixels={pixels}"])).shape for pixels in ("160", "null")}
    assert by_pixels == {"160": (120, 160), "null": (480, 640)}
    assert pressed_sensor(resolve("simulate-presses", "standard", ["simulate-presses.sensor=digit"])).shape == (160, 107)


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("shapes=[ball, bal]", "there is no shape 'bal'; there are ball, ellipsoid"),
        ("depth=[0.001, 0.0001]", "the least comes first, then the greatest"),
        ("sensor=gelsite", "there is no sensor 'gelsite', did you mean gelsight"),
    ],
)
def test_unusable_settings_are_named(assignment, message):
    with pytest.raises(InvalidInput, match=message):
        resolve("simulate-presses", "standard", [f"simulate-presses.{assignment}"])


@pytest.mark.parametrize(
    ("assignments", "words"),
    [
        (["depth=[0.001, 0.005]"], "0.005 m, the gel of gelsight is 0.004 m thick"),
        (["sensor=gel_16mm", "gel=[0.5, 2]"], "gel_16mm has neither membrane nor gel"),
        (
            ["sensor={soft}", "gel=[0.02, 2]"],
            "0.000136 m thick.*: make the gel at least as thick",
        ),  # 6.8 mm, in cells of a third of a millimetre
    ],
)
def test_gel_that_cannot_be_pressed_so_is_refused_before_the_run(surfaces, tmp_path, assignments, words):
    soft = elastic_sensor(tmp_path)
    assert SimulatePresses().assets(resolve("simulate-presses", "standard", [SENSOR.format(soft)])) == [soft]
    with pytest.raises(StageError, match=words):
        run_stage(surfaces, "simulate-presses", manifest(), *SMALL, *(f"simulate-presses.{text.format(soft=soft)}" for text in assignments))
