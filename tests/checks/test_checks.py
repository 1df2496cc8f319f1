"""`vt-pipeline check` of sensors, scenes and observations: faults are named, and a picture is drawn."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from pipeline.checks.description_checks import check_file, described_file
from pipeline.checks.hand_check import gel_lines
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path
from pipeline.formats.sensor_file import load_sensor
from tests.checks.edited_descriptions import edited
from tests.reconstruct.robot import write_files, write_observation


@pytest.mark.parametrize("name", ["two_finger_gripper", "supplement", "one-of-each"])
def test_shipped_files_have_no_faults_and_a_picture(name: str, tmp_path: Path) -> None:
    lines = check_file(described_file(name, tmp_path / "a.png"))
    assert "no faults" in lines[0]
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.width > 300


def test_elastic_gel_is_described_with_the_force_of_the_ball_in_the_picture(tmp_path: Path) -> None:
    path = edited("sensor", "gel_16mm", tmp_path / "soft.yaml", gel={"modulus": 2e5})
    (line,) = [line for line in check_file(described_file(str(path), tmp_path / "a.png")) if line.startswith("elastic")]
    layer = "elastic gel: 0.2 MPa, Poisson's ratio 0.48, 6.8 mm; the ball in the picture, 1.7 mm deep"
    found = re.fullmatch(layer + r", presses with (\S+) N, at most (\S+) kPa", line)
    assert found
    hertz = 4 / 3 * 2e5 / (1 - 0.48**2) * (0.01641 / 4) ** 0.5 * 0.0017**1.5
    assert hertz < float(found[1]) < 2.5 * hertz  # of a half-space; the layer's plate is near
    assert 30 < float(found[2]) < 300
    assert not [line for line in check_file(described_file("gel_16mm", tmp_path / "a.png")) if line.startswith("elastic")]


def test_friction_and_dots_of_a_gel_are_described(tmp_path: Path) -> None:
    dots, gel = {"rows": 4, "cols": 5, "radius": 5e-4}, {"modulus": 2e5, "friction": 0.6}
    path = edited("sensor", "gel_16mm", tmp_path / "dotted.yaml", gel=gel, markers=dots)
    lines = check_file(described_file(str(path), tmp_path / "a.png"))
    assert "markers: 5 x 4 dots 1 mm wide, 3.28 x 4.1 mm apart" in lines
    assert any("6.8 mm, friction 0.6; the ball" in line for line in lines)


def test_ball_in_the_picture_is_pressed_into_a_gel_that_is_low_in_the_middle(tmp_path: Path) -> None:
    dish = {"heights": [[0.0068] * 3, [0.0068, 0.004, 0.0068], [0.0068] * 3]}
    path = edited("sensor", "gel_16mm", tmp_path / "dish.yaml", gel={"modulus": 2e5}, surface=dish)
    (line,) = [line for line in check_file(described_file(str(path), tmp_path / "a.png")) if line.startswith("elastic")]
    assert re.search(r"the ball in the picture, 1(\.0\d)? mm deep, presses with \d*\.?\d*[1-9]\d* N", line)


def test_gel_lines_have_the_size_and_curvature_of_the_gel() -> None:
    base, rim, row, column = gel_lines(load_sensor("digit"))  # 20 x 30 x 5 mm, on a ball of 100 mm
    np.testing.assert_allclose(np.ptp(base, axis=0), [0.02, 0.03, 0])
    np.testing.assert_allclose([row[:, 2].max(), column[:, 2].max()], 0.005, atol=1e-5)
    np.testing.assert_allclose(rim[0], [-0.01, -0.015, 0.005 - 0.1 + np.sqrt(0.1**2 - 0.01**2 - 0.015**2)], atol=5e-5)


def test_scene_whose_camera_looks_away_is_faulty(tmp_path: Path) -> None:
    (camera,) = yaml.safe_load(description_path("scene", "supplement").read_text())["cameras"]
    path = edited("scene", "supplement", tmp_path / "seen.yaml", cameras=[camera | {"name": "default"}])
    assert "no faults" in check_file(described_file(str(path), tmp_path / "a.png"))[0]
    away = camera | {"name": "away", "rotation": [70.458, 4.94, -66.46]}
    path = edited("scene", "supplement", tmp_path / "away.yaml", cameras=json.loads(json.dumps([camera, away])))
    lines = check_file(described_file(str(path), tmp_path / "a.png"))
    assert "faults below" in lines[0]
    assert any(line.startswith("fault: away: 256 x 256 pixels") for line in lines)


def test_picture_replaces_a_symbolic_link_and_keeps_its_target(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    (tmp_path / "a.png").symlink_to(tmp_path / "thesis.txt")
    check_file(described_file("supplement", tmp_path / "a.png"))
    assert (tmp_path / "thesis.txt").read_text() == "mine"
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.width > 300


def test_picture_that_would_replace_a_file_of_the_observation_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_observation(tmp_path, write_files(tmp_path)).rename(tmp_path / "seen.yaml")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    for picture in (None, Path("seen.png"), tmp_path / "index.png"):
        with pytest.raises(InvalidInput, match=r"(seen|index).png is a file that .*seen.yaml needs, .*name another one with --picture"):
            described_file("seen.yaml", picture)
    with pytest.raises(InvalidInput, match=r"seen.yaml is a file that seen.yaml needs"):
        described_file("seen.yaml", tmp_path / "seen.yaml")
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert described_file(str(path), None)[2] == Path("seen.png")


def test_picture_of_an_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"a.xyz: the suffix .xyz names no picture format; use .*png"):
        check_file(described_file("supplement", tmp_path / "a.xyz"))


FORMULA = r"$\frac{$"
"""What matplotlib cannot read as a formula."""


def test_names_with_dollars_are_drawn_literally(tmp_path: Path) -> None:
    source = {"kind": "pybullet", "licence": "zlib", "category": FORMULA, "files": {"duck": {"file": "duck.obj"}}}
    manifest = {"name": "n", "description": "d", "seed": 0, "splits": {"train": 1, "valid": 0, "test": 0}, "sources": [source]}
    (tmp_path / "manifest.yaml").write_text(yaml.safe_dump(manifest))
    check_file(described_file(str(tmp_path / "manifest.yaml"), tmp_path / "manifest.png"))
