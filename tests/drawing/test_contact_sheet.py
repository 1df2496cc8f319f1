"""Contact sheets: pages, pictures, colours, and the row of one grasp."""

from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image

from pipeline.dataset.mesh_rows import mesh_row
from pipeline.drawing.colors import COLORS, depth_colors
from pipeline.drawing.contact_sheet import contact_sheets, sheet_row
from pipeline.drawing.grasp_pictures import GraspPictures, camera_images, grasp_note, size_note
from pipeline.drawing.picture_sheet import PAGE, PAPER, PICTURE, SheetRow, Tile, draw_sheet, scaled
from pipeline.errors import StoreError
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.touch.depth_maps import gel_surface
from stages.render_vision.renderer import Renderer
from tests.kernels.vision.shapes import SCENE, ball
from tests.stages import ball_dataset

SENSOR = load_sensor("gel_16mm")
NOISE = np.random.default_rng(0).integers(0, 256, (256, 256, 3)).astype(np.uint8)
ROW = SheetRow("an object", "a note", [Tile("one", [NOISE]), Tile("two", [NOISE, NOISE], "below", COLORS[0], filled=True)])


@pytest.fixture(scope="module")
def pictures() -> Iterator[GraspPictures]:
    with Renderer(SCENE) as renderer:
        yield GraspPictures(renderer, SCENE, load_hand("allegro_right"), [SENSOR] * 4)


def test_sheet_is_split_into_pages(tmp_path) -> None:
    files = draw_sheet([ROW] * (PAGE + 1), tmp_path / "sheet.png", title="title", note="note", sensor=SENSOR)
    assert [file.name for file in files] == ["sheet.png", "sheet-2.png"]
    sizes = []
    for file in files:
        with Image.open(file) as image:
            sizes.append(image.size)
    assert sizes[0][0] == sizes[1][0] > PICTURE
    assert sizes[0][1] > PAGE * PICTURE
    assert PICTURE < sizes[1][1] < 2 * PICTURE


def test_pictures_are_shown_pixel_for_pixel(tmp_path) -> None:
    (file,) = draw_sheet([ROW], tmp_path / "sheet.png", title="title", note="note")
    page = np.asarray(Image.open(file))
    corner = np.argwhere((page[:-256, :-256] == NOISE[0, 0]).all(axis=-1) & (page[255:-1, 255:-1] == NOISE[-1, -1]).all(axis=-1))
    assert any((page[r : r + 256, c : c + 256] == NOISE).all() for r, c in corner)


def test_sheet_of_no_objects_is_refused(tmp_path) -> None:
    with pytest.raises(ValueError, match="without rows"):
        draw_sheet([], tmp_path / "sheet.png", title="title", note="note")


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
    assert draw_sheet([ROW], tmp_path / "sheet.png", title="title", note="note", sensor=sensor)


def test_depth_colours_work_for_a_range_that_ends_with_the_gel() -> None:
    sensor = SENSOR.model_copy(update={"range": SENSOR.w})
    with np.errstate(all="raise"):
        inside, nothing = depth_colors(np.array([[0.0, np.inf]]), sensor)[0].astype(int)
    assert inside[0] > 200 > inside[2]
    assert nothing.min() == 250


def test_row_shows_hand_object_and_marks(pictures) -> None:
    hand_pose = np.eye(4)
    hand_pose[:3, 3] = [-0.1, 0.0, 0.55]
    angles = np.clip(np.full(16, 0.6), pictures.hand.lower, pictures.hand.upper)
    poses = sensor_poses(pictures.hand, hand_pose, angles)
    grasp = {"hand_pose": hand_pose, "joint_angles": angles, "sensor_pose": poses, "touch_success": np.ones(4, bool)}
    grasp |= dict.fromkeys(("penetration", "opposition", "closure", "contact_area"), 0.0)
    touch = {"depth": np.full((4, 100, 100), 0.003, np.float32), "tactile_image": np.zeros((4, 100, 100, 3), np.uint8)}
    rows = {
        "surfaces": mesh_row(ball(0.04)),
        "grasps": {name: np.array([value]) for name, value in grasp.items()},
        "vision": {"unoccluded": np.zeros((1, 256, 256, 3), np.uint8), "segmentation": np.ones((1, 1, 256, 256), np.uint8)},
        "touch": {name: value[None] for name, value in touch.items()},
    }
    tiles = sheet_row(pictures, "ball", rows).tiles
    assert [tile.caption for tile in tiles[:3]] == ["camera image", "from a second side", "touch sites"]  # it has no occluded images
    assert [(tile.caption, tile.note, tile.filled) for tile in tiles[3:4]] == [("index", "touch · 3.0 mm", True)]
    held, touched = tiles[1].pictures[0], tiles[2].pictures[0]
    assert held.shape == touched.shape == (256, 256, 3)
    background = held[0, 0].astype(int)
    for shown in (held, touched):
        away = np.abs(shown.astype(int) - background).max(axis=-1) > 20
        assert 0.05 < away.mean() < 0.95
        near = [np.abs(shown.astype(int) - color).max(axis=-1).min() for color in COLORS[:4]]
        assert max(near) < 60  # every finger's colour is there


def test_small_objects_are_enlarged_in_camera_images() -> None:
    small = np.zeros((2, 1, 256, 256), np.uint8)
    small[:, 0, 100:120, 100:120] = 1
    vision = {"unoccluded": np.zeros((1, 256, 256, 3), np.uint8), "occluded": np.full((1, 1, 256, 256, 3), 7, np.uint8)}
    (alone, image), (held, occluded) = camera_images(vision | {"segmentation": small}, 0)
    assert (alone, held) == ("camera image, enlarged 10.7 ×", "with the hand, enlarged 10.7 ×")
    assert image.shape == (24, 24, 3)
    assert (occluded == 7).all()
    (_, image), _ = camera_images(vision | {"segmentation": 0 * small}, 0)
    assert image.shape == (256, 256, 3), "nothing is visible"


@pytest.mark.parametrize(("margin", "words"), [(0.0, "not force-closed"), (0.25, "force-closed with margin 0.25")])
def test_grasp_note_describes_contact_closure_and_hold_test(margin, words) -> None:
    judged = {"opposition": [120.0], "closure": [margin], "contact_area": [[1e-4, 5e-5, 0]], "held": [False]}
    judged["held_directions"] = [[False] * 2 + [True] * 4]
    row = {"touch_success": np.array([[True, True, False]]), "penetration": np.array([4e-4])}
    note = grasp_note({**row, **{name: np.array(value) for name, value in judged.items()}}, 0)
    expected = f"150 mm² of contact, normals up to 120° apart; {words}; dropped in the hold test, in 4 of 6 directions"
    assert note == f"2 of 3 sensors touch; rigid parts at most 0.40 mm inside; {expected}"


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
    monkeypatch.setattr("pipeline.drawing.contact_sheet.draw_contact_sheet", lambda source, shown, path: path.write_text("a sheet"))
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
    monkeypatch.setattr("pipeline.drawing.contact_sheet.draw_contact_sheet", lambda *_: None)
    monkeypatch.setattr("pipeline.drawing.contact_sheet.hashes_of", lambda _: dict.fromkeys(reversed(names), "0" * 64))
    assert [sheet.name for sheet in contact_sheets(tmp_path, 1)] == names


def test_image_that_is_not_square_keeps_its_shape():
    shown = np.asarray(scaled(np.zeros((60, 80, 3), np.uint8), 80))
    assert (shown[10:70] == 0).all()
    assert (shown[[0, -1]] == PAPER).all()
