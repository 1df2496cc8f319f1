"""The layout of Open-X-Tactile: stores, episodes and tactile groups, and where the parts of any hand belong."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from pipeline.contrib.exports.functional_areas import joint_slots, tactile_areas
from pipeline.contrib.exports.grasp_frames import distinct_names
from pipeline.contrib.exports.oxt_files import _slug
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.model import Hand, Mount
from tests.command_line import vt
from tests.contrib.exports.test_exports import data, elastic  # noqa: F401
from tests.stages import ball_dataset

GROUPS = {"image": "image", "contact": "binary", "force": "state", "pressure": "matrix"}


def mounts(hand: Hand, **links: str) -> Hand:
    """Put sensors of these names on the named links."""
    numbers = {link.name: number for number, link in enumerate(hand.links)}
    return replace(hand, sensors=tuple(Mount(name, numbers[link], np.eye(4), "gel_16mm") for name, link in links.items()))


def test_stores_are_zarr_2_time_major_with_an_episode_per_object(elastic: Path, tmp_path: Path) -> None:  # noqa: F811
    vt("export", elastic, tmp_path / "out", "--to", "oxt")
    paths = sorted(path.relative_to(tmp_path / "out") for path in (tmp_path / "out").rglob("*.zarr"))
    assert paths == [Path("test", "grasp_bottle.zarr"), Path("test", "grasp_knife.zarr")]
    rows = ObjectRows(elastic, ["force", "pressure", "tactile_image", "touch_success", "joint_angles", "held", "hand_pose"], split=None)
    for path, object_id in zip(paths, rows.object_ids, strict=True):
        assert (tmp_path / "out" / path / ".zgroup").is_file()
        root: Any = zarr.open_group(str(tmp_path / "out" / path), mode="r")
        stored = root["data"]
        assert root["meta/episode_ends"][:].tolist() == [5]
        assert {stored[name].shape[0] for name in stored} == {5}
        read = {array: rows.read(array, object_id) for array in rows.arrays}
        tactile = {"image": read["tactile_image"], "force": read["force"][..., None], "pressure": read["pressure"]}
        for quantity, kind in GROUPS.items():
            group = f"{quantity}_gel_16mm"
            assert stored[f"right_tactile_area_{group}"][:].tolist() == [[1, 2, 3, 0]] * 5, "index, middle, ring, thumb"
            assert set(stored[f"right_tactile_sensor_{group}"][:]) == {"gel_16mm"}
            assert set(stored[f"right_tactile_type_{group}"][:]) == {kind}
            expected = tactile.get(quantity, read["touch_success"][..., None])
            np.testing.assert_array_equal(stored[f"right_tactile_data_{group}"][:], expected)
        assert stored["right_tactile_data_force_gel_16mm"].attrs["unit"] == "N"
        assert stored["right_tactile_data_pressure_gel_16mm"].attrs["unit"] == "Pa"
        np.testing.assert_array_equal(stored["right_hand_joints"][:], read["joint_angles"])
        np.testing.assert_array_equal(stored["right_wrist_pose"][:, :3], read["hand_pose"][:, :3, 3])
        np.testing.assert_array_equal(stored["held"][:], read["held"])
        assert set(stored["object_id"][:]) == {object_id}
        assert stored["camera_main_rgb"].shape == (5, 256, 256, 3)


def test_objects_of_a_category_are_episodes_of_one_store(tmp_path: Path) -> None:
    ball_dataset.make_data(tmp_path / "data", 3)
    vt("export", tmp_path / "data", tmp_path / "out", "--to", "oxt")
    root: Any = zarr.open_group(str(tmp_path / "out" / "test" / "grasp_bottle.zarr"), mode="r")
    assert root["meta/episode_ends"][:].tolist() == [5, 10]
    assert root["data/object_id"][:].tolist() == ["a"] * 5 + ["c"] * 5
    assert set(root["data/sub_task_instruction"][:]) == {"grasp a bottle"}
    images = ObjectRows(tmp_path / "data", ["tactile_image"], split=None)
    expected = np.concatenate([images.read("tactile_image", name) for name in ("a", "c")])
    np.testing.assert_array_equal(root["data/right_tactile_data_image_gel_16mm"][:], expected)


def test_categories_and_sensors_that_are_written_alike_are_numbered() -> None:
    """Without numbers, a store would hold two tasks, and a tactile group twice as many frames."""
    names = ["Coffee mug", "coffee-mug", "coffee_mug_2", "杯", "瓶"]
    assert [*distinct_names(names, _slug).values()] == ["coffee_mug", "coffee_mug_2", "coffee_mug_2_2", "other", "other_2"]


def test_forces_are_not_invented_where_no_gel_is_elastic(data: Path, tmp_path: Path) -> None:  # noqa: F811
    vt("export", data, tmp_path / "out", "--to", "oxt")
    stored: Any = zarr.open_group(str(tmp_path / "out" / "test" / "grasp_bottle.zarr"), mode="r")["data"]
    assert {name for name in stored if "_data_" in name} == {"right_tactile_data_image_gel_16mm", "right_tactile_data_contact_gel_16mm"}


def test_dataset_without_touches_is_refused(tmp_path: Path) -> None:
    ball_dataset.make_data(tmp_path / "data", 1)
    for name in ("touch", "charts"):
        (tmp_path / "data" / name).rename(tmp_path / name)
    assert "has no touches; run simulate-touch" in vt("export", tmp_path / "data", tmp_path / "out", "--to", "oxt", fails=True)


def test_allegro_has_the_slots_that_the_layout_draws_for_it() -> None:
    assert joint_slots(load_hand("allegro_right")) == [5, 7, 8, 9, 10, 12, 13, 14, 15, 17, 18, 19, 1, 0, 2, 3]


def test_thumb_of_five_joints_has_the_slots_of_the_shadow_hand() -> None:
    hand = load_hand("allegro_right")
    thumb, index = replace(hand.fingers[3], joints=(11, *hand.fingers[3].joints)), hand.fingers[0]
    others = (replace(hand.fingers[2], joints=hand.fingers[2].joints[:3]), hand.fingers[1], index)
    slots = joint_slots(replace(hand, fingers=(thumb, *others)))
    assert [slots[entry] for entry in thumb.joints] == [1, 0, 26, 3, 4]


def test_gripper_has_the_slot_of_grippers_and_the_areas_of_thumb_and_index() -> None:
    gripper = load_hand("two_finger_gripper")
    assert joint_slots(gripper) == [28]
    assert tactile_areas(gripper) == [0, 1]


def test_sensors_before_the_tip_and_on_the_palm_have_their_own_areas() -> None:
    hand = mounts(
        load_hand("allegro_right"), tip="link_3.0_tip", pad="link_2.0", base="link_1.0", palm="base_link", a="link_15.0", b="link_14.0"
    )
    assert tactile_areas(hand) == [1, 7, 11, 5, 0, 6]


def test_fingers_without_names_of_fingers_are_counted_from_the_thumb() -> None:
    hand = load_hand("allegro_right")
    fingers = tuple(replace(finger, name=f"finger-{number}") for number, finger in enumerate(hand.fingers))
    renamed = replace(hand, fingers=fingers)
    assert tactile_areas(mounts(renamed, a="link_3.0_tip", b="link_7.0_tip", c="link_15.0_tip")) == [0, 1, 2]
    assert len(set(joint_slots(renamed))) == 16


def test_hand_with_six_fingers_is_refused() -> None:
    hand = load_hand("allegro_right")
    extra = tuple(replace(hand.fingers[0], name=name, joints=()) for name in ("sixth", "seventh"))
    with pytest.raises(InvalidInput, match="Open-X-Tactile has five fingers, allegro_right has 6; use --to lerobot"):
        joint_slots(replace(hand, fingers=(*hand.fingers, *extra)))
