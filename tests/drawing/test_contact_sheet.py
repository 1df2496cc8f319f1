"""Contact sheets: pages, pictures, colours, and the band of one grasp."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image

from pipeline.dataset.mesh_rows import mesh_row
from pipeline.drawing.contact_sheet import BandMaker, band_maker, contact_sheets
from pipeline.drawing.contact_sheet_page import (
    COLORS,
    PAGE,
    PAPER,
    PICTURE,
    Band,
    _scaled,
    depth_colors,
    draw,
    enlarged,
    grasp_note,
    size_note,
)
from pipeline.errors import StoreError
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.touch.depth_maps import gel_surface
from tests.kernels.vision.shapes import SCENE, ball
from tests.stages import ball_dataset

SENSOR = load_sensor("gel_16mm")


def make_band(name: str) -> Band:
    depths = np.full((4, 100, 100), np.inf, np.float32)
    depths[0, 40:60] = 0.003
    depths[1] = 0.02
    pictures = [(text, np.full((256, 256, 3), shade, np.uint8)) for text, shade in (("one", 10), ("two", 200), ("three", 120))]
    tactile_images = np.full((4, 100, 100, 3), 90, np.uint8)
    return Band(
        name, "a note", pictures, ["index", "middle", "ring", "thumb"], np.array([True, False, False, False]), tactile_images, depths
    )


@pytest.fixture(scope="module")
def maker() -> Iterator[BandMaker]:
    hand = {"settings": {"hand": "allegro_right"}}
    vision, touch = hand | {"scene": SCENE.model_dump(mode="json")}, {"sensors": [SENSOR.model_dump()] * 4}
    with band_maker({"grasps": hand, "vision": vision, "touch": touch}) as opened:
        yield opened


def test_sheet_is_split_into_pages(tmp_path) -> None:
    files = draw([make_band(f"object-{k}") for k in range(PAGE + 1)], tmp_path / "sheet.png", [SENSOR] * 4, title="title", note="note")
    assert [file.name for file in files] == ["sheet.png", "sheet-2.png"]
    sizes = []
    for file in files:
        with Image.open(file) as image:
            image.load()
            assert image.mode == "RGB"
            sizes.append(image.size)
    assert sizes[0][0] == sizes[1][0] > 3 * PICTURE
    assert sizes[0][1] > PAGE * PICTURE
    assert PICTURE < sizes[1][1] < 2 * PICTURE


def test_pictures_are_shown_pixel_for_pixel(tmp_path) -> None:
    band = make_band("noise")
    noise = np.random.default_rng(0).integers(0, 256, (256, 256, 3)).astype(np.uint8)
    band = Band(band.title, band.note, [("noise", noise)], band.fingers, band.touched, band.tactile_images, band.depths)
    (file,) = draw([band], tmp_path / "sheet.png", [SENSOR] * 4, title="title", note="note")
    page = np.asarray(Image.open(file))
    corner = np.argwhere((page[:-256, :-256] == noise[0, 0]).all(axis=-1) & (page[255:-1, 255:-1] == noise[-1, -1]).all(axis=-1))
    assert any((page[r : r + 256, c : c + 256] == noise).all() for r, c in corner)


def test_sheet_of_no_objects_is_refused(tmp_path) -> None:
    with pytest.raises(ValueError, match="no objects"):
        draw([], tmp_path / "sheet.png", [SENSOR] * 4, title="title", note="note")


def test_depth_colours_distinguish_gel_beyond_gel_and_no_hit() -> None:
    deep, shallow, beyond, nothing = depth_colors(np.array([[0.0, SENSOR.w * 0.99, SENSOR.w * 1.01, np.inf]]), SENSOR)[0].astype(int)
    assert deep[0] > 200 > deep[2]  # yellow
    assert shallow.max() < 100  # dark violet
    assert np.ptp(beyond) < 10  # grey
    assert nothing.min() == 250


def test_depth_colours_follow_a_curved_gel(tmp_path) -> None:
    sensor = load_sensor("digit", shape=(20, 30))
    between = (gel_surface(sensor)[0, 0] + sensor.w) / 2  # beside the gel at its rim, in it in its middle
    depth = np.full(sensor.shape, between, np.float32)
    colors = depth_colors(depth, sensor).astype(int)
    assert np.ptp(colors[0, 0]) < 10 < np.ptp(colors[10, 15])
    band = make_band("rim")
    band = Band(band.title, band.note, band.pictures, band.fingers, band.touched, band.tactile_images, np.stack([depth] * 4))
    assert len(draw([band], tmp_path / "sheet.png", [sensor] * 4, title="title", note="note")) == 1


def test_depth_colours_work_for_a_range_that_ends_with_the_gel() -> None:
    sensor = SENSOR.model_copy(update={"range": SENSOR.w})
    with np.errstate(all="raise"):
        inside, nothing = depth_colors(np.array([[0.0, np.inf]]), sensor)[0].astype(int)
    assert inside[0] > 200 > inside[2]
    assert nothing.min() == 250


def test_band_shows_hand_object_and_marks(maker) -> None:
    hand_pose = np.eye(4)
    hand_pose[:3, 3] = [-0.1, 0.0, 0.55]
    angles = np.clip(np.full(16, 0.6), maker.hand.lower, maker.hand.upper)
    poses = sensor_poses(maker.hand, hand_pose, angles)
    grasp = {"hand_pose": hand_pose, "joint_angles": angles, "sensor_pose": poses, "touch_success": np.ones(4, bool), "penetration": 0.0}
    touch = {"depth": np.full((4, 100, 100), 0.003, np.float32), "tactile_image": np.zeros((4, 100, 100, 3), np.uint8)}
    rows = {
        "surfaces": mesh_row(ball(0.04)),
        "grasps": {name: np.array([value]) for name, value in grasp.items()},
        "vision": {"unoccluded": np.zeros((1, 256, 256, 3), np.uint8), "segmentation": np.ones((1, 1, 256, 256), np.uint8)},
        "touch": {name: value[None] for name, value in touch.items()},
    }
    band = maker.band("ball", rows)
    assert [text for text, _ in band.pictures] == ["unoccluded", "from a second side", "touch sites"]  # it has no occluded images
    held, felt = band.pictures[1][1], band.pictures[2][1]
    assert held.shape == felt.shape == (256, 256, 3)
    background = held[0, 0].astype(int)
    for shown in (held, felt):
        away = np.abs(shown.astype(int) - background).max(axis=-1) > 20
        assert 0.05 < away.mean() < 0.95
        near = [np.abs(shown.astype(int) - color).max(axis=-1).min() for color in COLORS[:4]]
        assert max(near) < 60  # every finger's colour is there
    small = np.zeros((1, 1, 256, 256), np.uint8)
    small[0, 0, 100:120, 100:120] = 1
    occluded = np.full((1, 1, 256, 256, 3), 7, np.uint8)
    again = maker.band("ball", {**rows, "vision": {**rows["vision"], "segmentation": small, "occluded": occluded}})
    assert [text for text, _ in again.pictures[:2]] == ["unoccluded, enlarged 10.7 ×", "occluded, enlarged 10.7 ×"]
    assert again.pictures[0][1].shape == (24, 24, 3)
    assert (again.pictures[1][1] == 7).all()
    assert (again.pictures[2][1] == held).all()


def test_image_without_visible_parts_is_not_enlarged() -> None:
    image = np.zeros((240, 320, 3), np.uint8)
    part, note = enlarged(image, np.zeros((2, 240, 320), bool))
    assert (part.shape, note) == (image.shape, "")


@pytest.mark.parametrize(("margin", "words"), [(0.0, "not force-closed"), (0.25, "force-closed with margin 0.25")])
def test_grasp_note_describes_contact_closure_and_hold_test(margin, words) -> None:
    judged = {"opposition": [120.0], "closure": [margin], "contact_area": [[1e-4, 5e-5, 0]], "held": [False]}
    judged["held_directions"] = [[False] * 2 + [True] * 4]
    row = {"touch_success": np.array([[True, True, False]]), "penetration": np.array([4e-4])}
    note = grasp_note({**row, **{name: np.array(value) for name, value in judged.items()}}, 0)
    expected = f"150 mm² of contact, normals up to 120° apart; {words}; dropped in the hold test, in 4 of 6 directions"
    assert note == f"2 of 3 sensors touch; rigid parts at most 0.40 mm inside; {expected}"
    assert grasp_note(row, 0).endswith("inside")  # of a dataset without these figures


def test_size_is_that_of_the_axis_aligned_bounding_box() -> None:
    assert size_note({"meshes/vertices": np.array([[0, 0, 0.5], [0.32, 0.1, 0.55], [0.1, 0.2, 0.65]])}) == "32 × 20 × 15 cm"


def test_progress_of_slow_sheets_is_shown(tmp_path, monkeypatch, capsys) -> None:
    ball_dataset.make_data(tmp_path, 2)
    monkeypatch.setattr("pipeline.console.SECONDS_PER_LINE", -1.0)
    assert contact_sheets(tmp_path, 2)
    assert "contact sheets: 1 of 2 objects" in capsys.readouterr().err


def test_changed_sheets_are_drawn_again_and_never_through_symbolic_links(tmp_path, monkeypatch) -> None:
    data, mine = tmp_path / "data", tmp_path / "thesis.txt"
    ball_dataset.make_data(data, 1)
    monkeypatch.setattr("pipeline.drawing.contact_sheet._draw", lambda collections, shown, path: path.write_text("a sheet"))
    (sheet,) = contact_sheets(data, 1)
    sheet.write_text("")
    (data / "contact-sheet-mine.png").write_text("mine")
    assert contact_sheets(data, 1) == [sheet]
    assert sheet.read_text() == "a sheet"
    assert (data / "contact-sheet-mine.png").exists()
    (data / "contact-sheet.key").write_bytes(b"\xff")
    assert contact_sheets(data, 1) == [sheet]
    mine.write_text("mine")
    for name in ("contact-sheet.png", "contact-sheet.key"):
        written = (data / name).read_bytes()
        (data / name).unlink()
        (data / name).symlink_to(mine)
        with pytest.raises(StoreError, match=f"{name} is a symbolic link to .*thesis.txt"):
            contact_sheets(data, 1)
        (data / name).unlink()
        (data / name).write_bytes(written)
    assert mine.read_text() == "mine"


def test_pages_are_listed_in_their_order(tmp_path, monkeypatch) -> None:
    ball_dataset.make_data(tmp_path, 1)
    names = ["contact-sheet.png", *(f"contact-sheet-{page}.png" for page in range(2, 12))]
    monkeypatch.setattr("pipeline.drawing.contact_sheet._draw", lambda *_: None)
    monkeypatch.setattr("pipeline.drawing.contact_sheet.hashes_of", lambda _: dict.fromkeys(reversed(names), "0" * 64))
    assert [sheet.name for sheet in contact_sheets(tmp_path, 1)] == names


def test_image_that_is_not_square_keeps_its_shape():
    shown = np.asarray(_scaled(np.zeros((60, 80, 3), np.uint8), 80))
    assert (shown[10:70] == 0).all()
    assert (shown[[0, -1]] == PAPER).all()
