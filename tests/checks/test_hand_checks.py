"""`vt-pipeline check` of hands: faults are named, and a trial grasps."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from pipeline.checks.description_checks import check_file
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path
from pipeline.formats.hand_file import load_hand
from stages.simulate_grasps.prepare import prepare_hand
from stages.simulate_grasps.stage import GraspSettings, SimulateGrasps
from tests.checks.edited_descriptions import edited


def test_hand_whose_sensor_faces_sideways_and_whose_fingers_are_in_the_palm_is_faulty(tmp_path: Path) -> None:
    urdf = load_hand("two_finger_gripper").urdf.read_text().replace('size="0.06 0.17 0.05"', 'size="0.06 0.17 0.4"')
    (tmp_path / "fat.urdf").write_text(urdf)
    described = yaml.safe_load(description_path("hand", "two_finger_gripper").read_text())
    described["fingers"][1]["sensor"] |= {"normal": [1, 0, 0], "columns": [0, 1, 0]}
    path = edited("hand", "two_finger_gripper", tmp_path / "fat.yaml", urdf="fat.urdf", fingers=described["fingers"])
    lines = check_file(str(path), tmp_path / "a.png")
    text = "\n".join(lines)
    assert "faults below" in lines[0]
    assert "the sensor right hardly moves along its normal" in text
    assert "overlap: [palm" not in text  # joined by a joint: what hangs from the palm may touch it


def plates(*spans: tuple[float, float]) -> str:
    """Write a link on the palm that blocks these spans of the left finger's way, m."""
    box = '<collision><origin xyz="0 {} 0.02"/><geometry><box size="0.06 {} 0.01"/></geometry></collision>'
    boxes = "".join(box.format((low + high) / 2, high - low) for low, high in spans)
    joint = '<joint name="screws" type="fixed"><parent link="palm"/><child link="guard"/></joint>'
    return f'<link name="guard">{boxes}</link>{joint}</robot>'


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("</robot>", plates((0.0195, 0.1)), r"left: 0 of 1024 postures are free of left_finger and guard \(boxes overlap"),
        (
            "</robot>",
            plates((0.0195, 0.0527), (0.0655, 0.1)),
            r"left: [1-9] of 1024 postures are free of left_finger and guard \(boxes overlap",
        ),
        (
            'size="0.028 0.012 0.034"',
            'size="0.028 0.2 0.034"',
            r"left and right: 0 of 2304 pairs of postures are free of left_finger and r",
        ),
    ],
)
def test_links_that_block_a_finger_are_a_fault_with_the_message_of_the_stage(old: str, new: str, fault: str, tmp_path: Path) -> None:
    urdf = load_hand("two_finger_gripper").urdf.read_text().replace(old, new)
    (tmp_path / "blocked.urdf").write_text(urdf.replace('<mimic joint="left_slide"/>', ""))
    path = edited("hand", "two_finger_gripper", tmp_path / "blocked.yaml", urdf="blocked.urdf")
    lines = check_file(str(path), tmp_path / "a.png")
    with pytest.raises(InvalidInput) as stopped:
        prepare_hand(GraspSettings(hand=str(path)))
    faults = [line.removeprefix("fault: ") for line in lines if line.startswith("fault: ") and "the gel of" not in line]
    assert "; ".join(faults) == str(stopped.value)
    assert re.match(fault, faults[0])
    assert re.search(r": write `allowed_contacts: \[\[.*\]\]` into ", faults[0])  # these links are boxes: nothing can be cut


def test_trial_reports_the_number_of_grasps_and_a_remedy_if_there_is_none(tmp_path: Path) -> None:
    lines = check_file("two_finger_gripper", tmp_path / "a.png")
    assert any(
        re.fullmatch(r"trial: ([5-9]|10) of 10 attempts at a ball of 70 mm are grasps, which touch with .* of 2 sensors", line)
        for line in lines
    )
    palm = {"link": "palm", "facing": [0, 0, -1], "centre": [0, 0, 0.09]}  # away from the fingers
    urdf = str(load_hand("two_finger_gripper").urdf)
    lines = check_file(str(edited("hand", "two_finger_gripper", tmp_path / "back.yaml", palm=palm, urdf=urdf)), tmp_path / "a.png")
    assert "faults below" in lines[0]
    (fault,) = [line for line in lines if line.startswith("fault: ")]
    assert "palm.facing" in fault
    described = yaml.safe_load(description_path("hand", "two_finger_gripper").read_text())
    for finger in described["fingers"]:  # on the backs of the fingers
        finger["sensor"]["normal"][1] *= -1
        finger["sensor"]["origin"][1] = 0.012 * finger["sensor"]["normal"][1]
    limits = Path(urdf).read_text().replace('<mimic joint="left_slide"/>', '<mimic joint="left_slide" multiplier="1.5"/>')
    (tmp_path / "wide.urdf").write_text(limits)
    path = edited("hand", "two_finger_gripper", tmp_path / "in.yaml", fingers=described["fingers"], urdf="wide.urdf")
    text = "\n".join(check_file(str(path), tmp_path / "a.png"))
    assert "no sensor touches the ball: do the sensors' normals point out of their links? Else let palm.facing" in text
    assert "joint right_slide follows left_slide through 0.0105 … 0.105, beyond its own limits 0.007 … 0.07, which do not count" in text


@pytest.mark.parametrize(
    ("sensor", "kind", "sentence"),
    [
        ({"origin": [0, 0.008, 0.082]}, "fault", "lies inside its link left_finger, which objects meet first; move its `origin` by 8 mm"),
        ({"origin": [0, 0.002, 0.082]}, "warning", "so that objects meet only the outer 4.8 mm of its gel; move its `origin` by 2 mm"),
        ({"normal": [0, 1, 0]}, "fault", "its normal points into the link: write `normal: [0, -1, 0]`"),
    ],
)
def test_gel_inside_its_link_is_named_with_the_place_where_it_belongs(
    sensor: dict[str, object], kind: str, sentence: str, tmp_path: Path
) -> None:
    described = yaml.safe_load(description_path("hand", "two_finger_gripper").read_text())
    described["fingers"][0]["sensor"] |= sensor
    urdf = str(load_hand("two_finger_gripper").urdf)
    path = edited("hand", "two_finger_gripper", tmp_path / "in.yaml", urdf=urdf, fingers=described["fingers"])
    lines = check_file(str(path), tmp_path / "a.png")
    assert ("faults below" in lines[0]) == (kind == "fault")
    assert [line.startswith(f"{kind}: ") for line in lines if sentence in line] == [True]
    misfits = list(SimulateGrasps().describe_misfits(GraspSettings(hand=str(path)), []))
    assert [sentence in line for line in misfits] == [True]


def test_hand_in_millimetres_is_a_fault(tmp_path: Path) -> None:
    palm = {"link": "palm", "facing": [0, 0, 1], "centre": [0, 0, 30]}
    urdf = str(load_hand("two_finger_gripper").urdf)
    lines = check_file(str(edited("hand", "two_finger_gripper", tmp_path / "mm.yaml", palm=palm, urdf=urdf)), tmp_path / "a.png")
    assert any(re.fullmatch(r"fault: the hand opens (29|30)(\.\d)? m; are lengths .* in millimetres\?", line) for line in lines)


def test_trial_of_a_hand_with_palm_sensors_only_reports_when_they_touch(tmp_path: Path) -> None:
    described = yaml.safe_load(description_path("hand", "two_finger_gripper").read_text())
    mount = {"link": "palm", "origin": [0, 0, -0.005], "normal": [0, 0, 1], "columns": [1, 0, 0]}
    fingers = [{"name": finger["name"], "joints": finger["joints"]} for finger in described["fingers"]]
    urdf, palm = str(load_hand("two_finger_gripper").urdf), described["palm"] | {"sensors": [mount]}
    lines = check_file(
        str(edited("hand", "two_finger_gripper", tmp_path / "p.yaml", urdf=urdf, palm=palm, fingers=fingers)), tmp_path / "a.png"
    )
    assert "no faults" in lines[0]
    assert any(line.startswith("trial: the palm's sensors touch what is nearer than their gel is thick") for line in lines)


def test_palm_far_from_the_fingers_is_a_fault(tmp_path: Path) -> None:
    palm = {"link": "palm", "facing": [0, 0, 1], "centre": [0, 0, -0.6]}  # as at the base of an arm
    urdf = str(load_hand("two_finger_gripper").urdf)
    lines = check_file(str(edited("hand", "two_finger_gripper", tmp_path / "far.yaml", palm=palm, urdf=urdf)), tmp_path / "a.png")
    assert "faults below" in lines[0]
    assert any("no sensor comes nearer to the palm's centre than 6" in line and "is palm.link, palm, the link" in line for line in lines)


def test_flat_collision_mesh_is_a_fault(tmp_path: Path) -> None:
    sheet = trimesh.Trimesh([[0, 0, 0], [0.02, 0, 0], [0, 0.02, 0]], [[0, 1, 2]])
    sheet.export(tmp_path / "sheet.stl")
    text = load_hand("two_finger_gripper").urdf.read_text()
    mesh = '<collision><geometry><mesh filename="sheet.stl"/></geometry></collision></link>'
    (tmp_path / "flat.urdf").write_text(text.replace("</link>", mesh, 1))
    lines = check_file(str(edited("hand", "two_finger_gripper", tmp_path / "flat.yaml", urdf="flat.urdf")), tmp_path / "a.png")
    assert any(line.startswith("fault: ") and "sheet.stl of link palm is flat" in line for line in lines)


def test_links_without_visuals_are_named(tmp_path: Path) -> None:
    text = load_hand("two_finger_gripper").urdf.read_text()
    (tmp_path / "bare.urdf").write_text(re.sub(r"(<link name=.left_finger.>)(.*?)(<collision>)", drop_visuals, text, flags=re.S))
    path = edited("hand", "two_finger_gripper", tmp_path / "bare.yaml", urdf="bare.urdf")
    lines = check_file(str(path), tmp_path / "a.png")
    assert "camera images do not show links that have collision shapes and no visual: left_finger" in lines


def drop_visuals(found: re.Match[str]) -> str:
    return found[1] + re.sub(r"<visual>.*?</visual>", "", found[2], flags=re.S) + found[3]


def test_all_faults_of_a_hand_file_are_named_at_once(tmp_path: Path) -> None:
    described = yaml.safe_load(description_path("hand", "two_finger_gripper").read_text())
    described["fingers"][0]["joints"] = ["left_slip"]
    described["fingers"][1]["sensor"] |= {"link": "thumb"}
    described["palm"]["facing"] = [0, 0, 0]
    path = tmp_path / "wrong.yaml"
    path.write_text(yaml.safe_dump(described | {"urdf": str(load_hand("two_finger_gripper").urdf), "convex_parts": {"fist": 2}}))
    with pytest.raises(InvalidInput) as error:
        check_file(str(path), tmp_path / "a.png")
    for said in ("no moving joint 'left_slip'", "no sensor link 'thumb'", "facing is the zero vector", "no link 'fist'"):
        assert said in str(error.value)


def test_check_of_a_hand_reports_the_loss_and_filling_of_convex_shapes(tmp_path: Path) -> None:
    """A palm of 20,480 faces with a dent of a centimetre."""
    described = yaml.safe_load(description_path("hand", "two_finger_gripper").read_text())
    palm = trimesh.creation.icosphere(subdivisions=5, radius=0.03)
    away = np.linalg.norm(palm.vertices - [0, 0, 0.03], axis=1)
    palm.vertices[:, 2] -= 0.01 * np.exp(-((away / 0.008) ** 2))
    palm.export(tmp_path / "palm.stl")
    urdf = load_hand("two_finger_gripper").urdf.read_text()
    urdf = re.sub(r'<collision>(<origin[^>]*>)?<geometry><box size="0.06 0.17 0.05"/></geometry></collision>', PALM_MESH, urdf)
    (tmp_path / "dented.urdf").write_text(urdf)
    path = edited("hand", "two_finger_gripper", tmp_path / "dented.yaml", urdf="dented.urdf", fingers=described["fingers"])
    lines = check_file(str(path), tmp_path / "a.png")
    (taken,) = (line for line in lines if line.startswith("collision meshes of 1 link are taken as convex: 20480 faces became "))
    lost = re.search(r"became (\d+), and (\d\.\d\d) mm is the most", taken)
    assert lost is not None
    assert int(lost[1]) <= 1000
    assert float(lost[2]) <= 0.4
    assert any(re.fullmatch(r"hollows of meshes that this fills, by depth: palm \d mm; they matter .*", line) for line in lines)


PALM_MESH = '<collision><geometry><mesh filename="palm.stl"/></geometry></collision>'
