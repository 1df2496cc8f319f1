"""`vt-pipeline check` of hands: faults are named, and a trial grasps."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from pipeline.checks.description_checks import check_file, described_file
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path
from pipeline.formats.hand_file import load_hand
from stages.simulate_grasps.grasp_search import GraspSearch
from stages.simulate_grasps.prepare import prepare_hand
from stages.simulate_grasps.stage import GraspSettings, SimulateGrasps
from tests.checks.edited_descriptions import edited

URDF = load_hand("two_finger_gripper").model
DESCRIBED = description_path("hand", "two_finger_gripper").read_text()


def gripper(folder: Path, urdf: str | None = None, **changes: Any) -> Path:
    """Write a changed gripper, perhaps with another URDF."""
    (folder / "other.urdf").write_text(URDF.read_text() if urdf is None else urdf)
    return edited("hand", "two_finger_gripper", folder / "hand.yaml", model="other.urdf", **changes)


def lines_of(folder: Path, urdf: str | None = None, **changes: Any) -> list[str]:
    return check_file(described_file(str(gripper(folder, urdf, **changes)), folder / "a.png"))


def fingers(number: int, **sensor: Any) -> list[dict[str, Any]]:
    """Change the sensor of one finger."""
    described: list[dict[str, Any]] = yaml.safe_load(DESCRIBED)["fingers"]
    described[number]["sensor"] |= sensor
    return described


def test_hand_whose_sensor_faces_sideways_and_whose_fingers_are_in_the_palm_is_faulty(tmp_path: Path) -> None:
    urdf = URDF.read_text().replace('size="0.06 0.17 0.05"', 'size="0.06 0.17 0.4"')
    lines = lines_of(tmp_path, urdf, fingers=fingers(1, normal=[1, 0, 0], columns=[0, 1, 0]))
    assert "faults below" in lines[0]
    assert any("the sensor right hardly moves along its normal" in line for line in lines)
    assert not any("overlap: [palm" in line for line in lines)  # joined by a joint: what hangs from the palm may touch it


def plates(*spans: tuple[float, float]) -> str:
    """Write a link on the palm that blocks these spans of the left finger's way, m."""
    box = '<collision><origin xyz="0 {} 0.02"/><geometry><box size="0.06 {} 0.01"/></geometry></collision>'
    boxes = "".join(box.format((low + high) / 2, high - low) for low, high in spans)
    joint = '<joint name="screws" type="fixed"><parent link="palm"/><child link="guard"/></joint>'
    return f'<link name="guard">{boxes}</link>{joint}</robot>'


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("</robot>", plates((0.0195, 0.1)), r"left: 0 of 1024 postures are free of left_finger and guard"),
        ("</robot>", plates((0.0195, 0.0527), (0.0655, 0.1)), r"left: [1-9] of 1024 postures are free of left_finger and guard"),
        (
            'size="0.028 0.012 0.034"',
            'size="0.028 0.2 0.034"',
            r"left and right: 0 of 2304 pairs of postures are free of left_finger and r",
        ),
    ],
)
def test_links_that_block_a_finger_are_a_fault_with_the_message_of_the_stage(old: str, new: str, fault: str, tmp_path: Path) -> None:
    urdf = URDF.read_text().replace(old, new).replace('<mimic joint="left_slide"/>', "")
    lines = lines_of(tmp_path, urdf)
    with pytest.raises(InvalidInput) as stopped:
        prepare_hand(GraspSettings(hand=str(tmp_path / "hand.yaml")))
    faults = [line.removeprefix("fault: ") for line in lines if line.startswith("fault: ") and "the gel of" not in line]
    assert "; ".join(faults) == str(stopped.value)
    assert re.match(fault, faults[0])
    assert re.search(r": write `allowed_contacts: \[\[.*\]\]` into ", faults[0])  # these links are boxes: nothing can be cut


def palm(facing: int, centre: float) -> dict[str, Any]:
    return {"link": "palm", "facing": [0, 0, facing], "centre": [0, 0, centre]}


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        (palm(1, 30), r"the hand opens (29|30)(\.\d)? m; are lengths .* in millimetres\?"),
        (palm(1, -0.6), r"no sensor comes nearer to the palm's centre than 6.*is palm.link, palm, the link"),  # as at the base of an arm
        (palm(-1, 0.09), r".*palm\.facing"),  # away from the fingers: no attempt is a grasp
    ],
    ids=["millimetres", "far", "backwards"],
)
def test_wrong_palm_is_a_fault(changed: dict[str, Any], fault: str, tmp_path: Path) -> None:
    lines = lines_of(tmp_path, palm=changed)
    assert "faults below" in lines[0]
    assert any(re.match(f"fault: {fault}", line) for line in lines)


def test_gels_that_overload_the_motors_have_a_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GraspSearch, "closed", lambda search, pose, start, angles: (angles, False))
    (fault,) = (line for line in lines_of(tmp_path) if line.startswith("fault: "))
    assert re.search("mostly because a gel presses harder than .*; raise torque in the hand file", fault)


def test_trial_reports_the_number_of_grasps_and_limits_that_do_not_count(tmp_path: Path) -> None:
    trial = r"trial: ([5-9]|10) of 10 attempts at a ball of 70 mm are grasps, which touch with .* of 2 sensors"
    assert any(re.fullmatch(trial, line) for line in lines_of(tmp_path))
    described = yaml.safe_load(DESCRIBED)["fingers"]
    for finger in described:  # on the backs of the fingers
        finger["sensor"]["normal"][1] *= -1
        finger["sensor"]["origin"][1] = 0.012 * finger["sensor"]["normal"][1]
    urdf = URDF.read_text().replace('<mimic joint="left_slide"/>', '<mimic joint="left_slide" multiplier="1.5"/>')
    text = "\n".join(lines_of(tmp_path, urdf, fingers=described))
    assert "no sensor touches the ball: do the sensors' normals point out of their links? Else let palm.facing" in text
    assert "joint right_slide follows left_slide through 0.0105 … 0.105, beyond its own limits 0.007 … 0.07, which do not count" in text


def test_joints_without_limits_are_named(tmp_path: Path) -> None:
    urdf = URDF.read_text().replace('name="left_slide" type="prismatic"', 'name="left_slide" type="continuous"')
    assert any("joints without limits, which may turn by half a turn either way: left_slide" in line for line in lines_of(tmp_path, urdf))


@pytest.mark.parametrize(
    ("sensor", "kind", "sentence"),
    [
        ({"origin": [0, 0.008, 0.082]}, "fault", "lies inside its link left_finger, which objects meet first; move its `origin` by 8 mm"),
        ({"origin": [0, 0.002, 0.082]}, "warning", "so that objects meet only the outer 4.8 mm of its gel; move its `origin` by 2 mm"),
        ({"normal": [0, 1, 0]}, "fault", "its normal points into the link: write `normal: [0, -1, 0]`"),
        (
            {"normal": [0, 1, 0], "origin": [0, -0.044, 0.082]},
            "fault",
            "write `normal: [0, -1, 0]`, and move its `origin` by 44 mm, to [0, 0,",
        ),
        ({"origin": [0, -0.044, 0.082]}, "fault", "lies 44 mm in front of its link left_finger, which does not carry it there; move"),
        ({"origin": [0, 0, 0.18]}, "fault", "in front of its link left_finger"),  # beyond the tip
        ({"origin": [0, -0.003, 0.082]}, "warning", "lies 3 mm in front of its link left_finger"),
    ],
)
def test_sensor_off_the_surface_of_its_link_is_named_with_the_remedy(
    sensor: dict[str, object], kind: str, sentence: str, tmp_path: Path
) -> None:
    lines = lines_of(tmp_path, fingers=fingers(0, **sensor))
    assert ("faults below" in lines[0]) == (kind == "fault")
    assert [line.startswith(f"{kind}: ") for line in lines if sentence in line] == [True]
    misfits = list(SimulateGrasps().describe_misfits(GraspSettings(hand=str(tmp_path / "hand.yaml")), []))
    assert [sentence in line for line in misfits] == [True]


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        (
            {"centre": [0, 0, -0.005]},
            "seldom touches with search=touch: its gel reaches 6.8 mm beyond palm.centre, which is set 5 to 60 mm",
        ),
        ({"centre": [0, 0, -0.003]}, "cannot touch with search=touch: .* simulate-grasps.greatest_distance=0.0048"),
        ({"centre": [0, 0, 0.03]}, "cannot touch: its gel lies 28.2 mm behind palm.centre; move that to the gel"),
        ({"facing": [0, 0, -1]}, "cannot touch: it faces away from where palm.facing points"),
    ],
)
def test_palm_that_cannot_touch_is_named_with_the_remedy(place: dict[str, Any], sentence: str, tmp_path: Path) -> None:
    described = yaml.safe_load(DESCRIBED)
    mount = {"link": "palm", "origin": [0, 0, -0.005], "normal": [0, 0, 1], "columns": [1, 0, 0]}
    bare = [{"name": finger["name"], "joints": finger["joints"]} for finger in described["fingers"]]
    lines = lines_of(tmp_path, palm=described["palm"] | {"sensors": [mount]} | place, fingers=bare)
    assert [bool(re.search(sentence, line)) for line in lines if line.startswith("warning: the sensor palm of the palm")] == [True]


def test_nearest_surface_point_of_each_sensor_and_units_of_motors_are_printed(tmp_path: Path) -> None:
    lines = lines_of(tmp_path, fingers=fingers(0, origin=[0.001, -0.044, 0.08], normal=[0.3, -1, 0], columns=[1, 0.3, 0]))
    surface = "{origin: [0.001, 0, 0.08], normal: [0, -1, 0], columns: [1, 0, 0]}"
    assert f"surface of left_finger, 44 mm from the origin of sensor left: {surface}" in lines
    assert lines[2].startswith("motors 20 N, friction 0.5")
    assert [load_hand("allegro_right").torque_unit, load_hand("two_finger_gripper").torque_unit] == ["N m", "N"]


def test_flat_collision_meshes_are_a_fault_and_links_without_visuals_are_named(tmp_path: Path) -> None:
    trimesh.Trimesh(np.diag([0.02, 0.02, 0.0]), [[0, 1, 2]]).export(tmp_path / "sheet.stl")
    mesh = '<collision><geometry><mesh filename="sheet.stl"/></geometry></collision></link>'
    text = re.sub(r"(<link name=.left_finger.>)(.*?)(<collision>)", drop_visuals, URDF.read_text(), flags=re.S)
    lines = lines_of(tmp_path, text.replace("</link>", mesh, 1))
    assert any(line.startswith("fault: ") and "sheet.stl of link palm is flat" in line for line in lines)
    assert "camera images do not show links that have collision shapes and no visual: left_finger" in lines


def drop_visuals(match: re.Match[str]) -> str:
    return match[1] + re.sub(r"<visual>.*?</visual>", "", match[2], flags=re.S) + match[3]


def test_all_faults_of_a_hand_file_are_named_at_once(tmp_path: Path) -> None:
    described = yaml.safe_load(DESCRIBED)
    described["fingers"][0]["joints"] = ["left_slip"]
    described["fingers"][1]["sensor"] |= {"link": "thumb"}
    with pytest.raises(InvalidInput) as error:
        lines_of(tmp_path, fingers=described["fingers"], palm=described["palm"], convex_parts={"fist": 2})
    for said in ("no moving joint 'left_slip'", "no sensor link 'thumb'", "no link 'fist'"):
        assert said in str(error.value)


def test_check_of_a_hand_reports_the_loss_and_filling_of_convex_shapes(tmp_path: Path) -> None:
    """A palm of 20,480 faces with a dent of a centimetre."""
    dented = trimesh.creation.icosphere(subdivisions=5, radius=0.03)
    away = np.linalg.norm(dented.vertices - [0, 0, 0.03], axis=1)
    dented.vertices[:, 2] -= 0.01 * np.exp(-((away / 0.008) ** 2))
    dented.export(tmp_path / "palm.stl")
    box = r'<collision>(<origin[^>]*>)?<geometry><box size="0.06 0.17 0.05"/></geometry></collision>'
    mesh = '<collision><geometry><mesh filename="palm.stl"/></geometry></collision>'
    lines = lines_of(tmp_path, re.sub(box, mesh, URDF.read_text()))
    (taken,) = (line for line in lines if line.startswith("collision meshes of 1 link are taken as convex: 20480 faces became "))
    lost = re.search(r"became (\d+), and (\d\.\d\d) mm is the most", taken)
    assert lost is not None
    assert int(lost[1]) <= 1000
    assert float(lost[2]) <= 0.4
    assert any(re.fullmatch(r"hollows of meshes that this fills, by depth: palm \d mm; they matter .*", line) for line in lines)
