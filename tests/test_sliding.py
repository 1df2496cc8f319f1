"""Slides of the library: paths over a ball, what may be asked of a step, and paths that are refused."""

import numpy as np
import pytest
import trimesh

import vt_pipeline as vt
from pipeline.kernels.touch.markers import MarkerGrid
from pipeline.kernels.touch.sensor import Gel, Sensor

RADIUS, FRICTION = 0.004, 0.5
MESH = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
BALL = vt.load_object((MESH.vertices, MESH.faces))
SENSOR = vt.load_sensor("gelsight", shape=(48, 64)).model_copy(update={"gel": Gel(modulus=2e5, thickness=0.004), "membrane": 0.0})
STEPS = 6


def path(*, depth: float = 5e-4, along: tuple[float, float] = (0.0, 0.0), turn: float = 0.0, tilt: float = 0.0) -> np.ndarray:
    """Press onto the ball, which is under the sensor, then slide, twist and tilt about the ball's top at once: (2 STEPS, 4, 4)."""
    poses = []
    for press, share in [*((k / (STEPS - 1), 0) for k in range(STEPS)), *((1, (k + 1) / STEPS) for k in range(STEPS))]:
        (c, s), (d, t) = ((np.cos(share * angle), np.sin(share * angle)) for angle in (turn, tilt))
        rotation = np.array([[d, 0, t], [0, 1, 0], [-t, 0, d]]) @ np.diag([1.0, -1, -1]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = (share * along[0], share * along[1], RADIUS) - rotation[:, 2] * (SENSOR.w - depth * (1.05 * press - 0.05))
        poses.append(pose)
    return np.array(poses)


def last(poses: np.ndarray, sensor: Sensor = SENSOR, **options: float) -> vt.SlidingTouch:
    return list(vt.slide(BALL, sensor, poses, **{"friction": FRICTION} | options))[-1]


def test_step_is_the_touch_of_its_pose_with_what_friction_adds():
    poses = path(along=(2e-4, 0))
    slid = last(poses)
    touch = vt.touch(BALL, SENSOR, poses[-1])
    assert (slid.depth == touch.depth).all()
    assert (slid.image == touch.image).all()
    assert (slid.pressure == touch.pressure).all()
    assert slid.traction.shape == slid.displacement.shape == slid.slip.shape == (48, 64, 2)
    assert (np.hypot(*np.moveaxis(slid.traction, -1, 0)) <= FRICTION * slid.pressure * (1 + 1e-5)).all()
    assert slid.settled
    assert (slid.slips <= slid.contact).all()
    assert 0 < slid.slip_share < 1
    assert not slid.gross_slip
    assert slid.traction.sum(axis=(0, 1)) * np.prod(SENSOR.pitch) == pytest.approx(slid.shear_force)


def test_object_that_lags_behind_drags_the_gel_back_until_it_slips():
    """The sensor's x is the ball's, its y is opposite."""
    some, more, far = (last(path(along=(reach, 0))) for reach in (1e-4, 2e-4, 2e-3))
    assert 0 > some.shear_force[0] > more.shear_force[0] > far.shear_force[0]
    assert far.shear_force == pytest.approx([-FRICTION * far.force, 0], rel=2e-3, abs=2e-3 * far.force)
    assert far.gross_slip
    assert far.slip_share == 1
    assert np.median(far.slip[far.contact], axis=0) == pytest.approx([-2e-3 / STEPS, 0], rel=0.05, abs=1e-5)
    assert last(path(along=(0, 1e-4))).shear_force == pytest.approx(-some.shear_force[::-1], rel=0.02, abs=1e-3 * some.force)


def test_sensor_that_twists_feels_a_torque_and_that_of_a_mirrored_path_is_opposite():
    one, other, slower = (last(path(turn=turn)) for turn in (0.2, -0.2, 0.05))
    assert one.torque < slower.torque < 0  # the object turns the other way
    assert other.torque == pytest.approx(-one.torque, rel=1e-3)
    assert abs(one.torque) < 3 * np.pi / 16 * FRICTION * one.force * np.sqrt(one.contact_area / np.pi) * 1.05
    assert np.hypot(*one.shear_force) < 1e-3 * one.force


def test_sensor_that_rocks_on_the_ball_is_sheared_far_less_than_one_that_moves_around_it():
    """By 0.1 rad about the ball's top, which rolls on the gel, or about its middle."""
    poses = path(tilt=0.1)
    rocked = last(poses)
    poses[STEPS:, :3, 3] = -poses[STEPS:, :3, 2] * (RADIUS + SENSOR.w - 5e-4)
    around = last(poses)
    assert around.force == pytest.approx(last(path()).force, rel=0.02)
    assert around.shear_force[0] < -10 * abs(rocked.shear_force[0])


def test_path_goes_on_after_a_step_as_if_it_had_not_stopped():
    poses = path(along=(2e-4, 1e-4), turn=0.1)
    whole = last(poses)
    first = list(vt.slide(BALL, SENSOR, poses[:8], friction=FRICTION))
    assert [touch.contact.any() for touch in first[:2]] == [False, True]
    rest = list(vt.slide(BALL, SENSOR, poses[8:], friction=FRICTION, after=first[-1]))
    assert (rest[-1].traction == whole.traction).all()
    assert not list(vt.slide(BALL, SENSOR, poses[:0], friction=FRICTION))
    other = SENSOR.model_copy(update={"rows": 24, "gel": Gel(modulus=1e5)})
    with pytest.raises(vt.InvalidInput, match=r"of Sensor\(gelsight, \(48, 64\) .*, another gel, rows: give both the same sensor"):
        vt.slide(BALL, other, poses[8:], friction=FRICTION, after=first[-1])


def test_gel_that_lifts_off_is_at_rest_and_friction_of_the_file_is_the_default():
    poses = path(along=(2e-4, 0))
    worn = SENSOR.model_copy(update={"gel": SENSOR.gel.model_copy(update={"friction": FRICTION})})
    up = np.concatenate([poses, poses[-1:], poses[-1:]])
    up[-2:, 2, 3] += 1e-3
    *_, before, lifted, _ = vt.slide(BALL, worn, up)
    assert (before.traction == last(poses).traction).all()
    assert lifted.contact.sum() == lifted.slip_share == lifted.torque == 0
    assert not lifted.displacement.any()
    assert not lifted.gross_slip


def test_markers_move_with_the_gel_and_are_drawn_where_they_are():
    sensor = SENSOR.model_copy(update={"rows": 96, "cols": 128})
    step = last(path(along=(3e-4, 0)), sensor)
    moved = vt.markers(step, [(0.0, 0.0), (6e-3, 4e-3)])
    assert moved.displacement[0] == pytest.approx(step.displacement[47:49, 63:65].mean(axis=(0, 1)), rel=1e-3, abs=1e-9)
    assert -3e-4 < moved.displacement[0, 0] < 5 * moved.displacement[1, 0] < 0
    dark = (moved.image.astype(int) - step.image).sum(axis=-1)[40:56, 50:78]
    middle = np.average(np.argwhere(dark)[:, 1], weights=-dark[dark != 0]) + 50
    assert middle == pytest.approx(63.5 + moved.displacement[0, 0] / sensor.pitch[1], abs=0.3)
    printed = sensor.model_copy(update={"markers": MarkerGrid(rows=3, cols=4, radius=2e-4)})
    assert vt.markers(last(path(), printed)).positions.shape == (12, 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"friction": -0.1}, r"friction is -0\.1; a coefficient is from 0 to 1000"),
        ({"friction": np.nan}, "friction is nan"),
        ({"friction": np.inf}, "friction is inf"),
        ({"friction": None}, "the friction of sensor gelsight is not known: give friction, or add `gel: {friction: …}` to its file"),
        ({"sensor": SENSOR.model_copy(update={"gel": None})}, "sensor gelsight has no elastic gel, which slides and lifts need"),
        ({"poses": path()[STEPS:]}, r"poses\[0\] is in contact, 0\.[45]\d* mm deep, and the shear of the gel is unknown"),
        (
            {"poses": path(along=(0.05, 0))},
            r"poses\[6\]: the object moves by 0\.00833 m .* thickness, 0\.004 m: add poses in between",
        ),
        (
            {"sensor": SENSOR.model_copy(update={"gel": Gel(modulus=2e5, thickness=1e-4)})},
            r"is 0\.0001 m thick, its contact is solved on cells",
        ),
        ({"poses": np.full((3, 4, 4), np.nan)}, r"poses\[0\] is not a rigid motion: it holds numbers that are not finite"),
        ({"poses": path().transpose(0, 2, 1)}, r"poses\[0\] is not a rigid motion: its last row is not 0 0 0 1; is it transposed\?"),
        (
            {"poses": path() * [[1.1], [1.1], [1.1], [1]]},
            r"poses\[0\] is .*: its axes are 0\.21 from orthonormal, at most 1e-06; scale",
        ),
        ({"poses": path() * [-1, 1, 1, 1]}, r"poses\[0\] is not a rigid motion: its axes are left-handed; turn one around"),
    ],
)
def test_path_that_cannot_be_followed_is_refused_with_the_remedy(change, message):
    options = {"sensor": SENSOR, "poses": path(), "friction": FRICTION} | change
    with pytest.raises(vt.InvalidInput, match=message):
        list(vt.slide(BALL, **options))


def test_first_pose_is_judged_before_a_step_is_taken():
    with pytest.raises(vt.InvalidInput, match="is in contact"):
        vt.slide(BALL, SENSOR, path()[STEPS:], friction=FRICTION)


@pytest.mark.parametrize(
    ("dots", "error", "message"),
    [
        (None, vt.InvalidInput, r"sensor gelsight has no markers: give dots, \(N, 2\) in m, or add `markers:"),
        ([(0, 0), (0.02, 0)], vt.InvalidInput, r"dot 1 is at \[0\.02, 0\.0\] m, outside the gel of sensor gelsight, which spans ±"),
        ([(0, np.nan)], vt.InvalidInput, "dot 0 is at"),
        (np.zeros((4, 3)), TypeError, r"dots are positions \(N, 2\), m"),
        ("all", TypeError, r"dots are positions \(N, 2\), m"),
        (3.0, TypeError, r"dots are positions \(N, 2\), m"),
    ],
)
def test_dots_that_cannot_be_moved_are_refused(dots, error, message):
    with pytest.raises(error, match=message):
        vt.markers(last(path()), dots)


def test_markers_need_a_step_of_a_slide_and_friction_a_number():
    with pytest.raises(TypeError, match="markers are moved by a step of slide; this is Touch"):
        vt.markers(vt.touch(BALL, SENSOR, path()[-1]), [(0, 0)])
    with pytest.raises(TypeError, match="after is a step of slide; this is Touch"):
        vt.slide(BALL, SENSOR, path(), friction=FRICTION, after=vt.touch(BALL, SENSOR, path()[-1]))
    with pytest.raises(TypeError, match="friction is a number; this is str"):
        vt.slide(BALL, SENSOR, path(), friction="high")
