"""Friction against closed forms: Cattaneo and Mindlin's ball, its load cycle and twist, a layer in shear; against a slow twin, and limits.

Balls press with Hertz's pressure itself. Closed forms for them neglect that pressure displaces the surface sideways, as it does below
Poisson's ratio of a half in a half-space; there, `no_pull` does so too.
"""

import numpy as np
import pytest
from scipy.signal import fftconvolve

from pipeline.errors import InvalidInput
from pipeline.kernels.touch import friction
from pipeline.kernels.touch.depth_maps import normal_force, press_gel
from pipeline.kernels.touch.elastic_contact import PressedGel, press_elastic
from pipeline.kernels.touch.friction import drag_gel, gel_at_rest, object_motion, on_pixels, surface_displacement, surface_traction
from pipeline.kernels.touch.press_shapes import PressRanges, random_press
from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from pipeline.kernels.touch.shear_layer import MIRRORED, shear_displacement, shear_influence
from tests.kernels.touch.gels import FRICTION, RADIUS, E, forces, hertz, sensor, shear_modulus, shift, torque
from tests.kernels.touch.shapes import frame
from tests.references.slow_friction import slow_drag


@pytest.fixture
def no_pull(monkeypatch):
    monkeypatch.setattr(friction, "shear_displacement", lambda *grid: shear_displacement(*grid)._replace(pull=np.zeros((), np.complex64)))


def cattaneo(share: float, worn: Sensor, force: float) -> float:
    """Compute how far a ball is moved by a share of the force that makes it slide, m."""
    return (1 - (1 - share) ** (2 / 3)) * 3 * FRICTION * force * (2 - worn.gel.poisson) / (16 * shear_modulus(worn) * RADIUS)


@pytest.mark.usefixtures("no_pull")
@pytest.mark.parametrize("cells", [20, pytest.param(40, marks=pytest.mark.slow)])
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_ball_follows_cattaneo_and_mindlin(poisson, share, cells):
    """Force, and radius of the part that sticks."""
    worn = sensor(int(2.4 * cells), int(2.4 * cells), poisson, pitch=RADIUS / cells)
    pressed, state = hertz(worn), gel_at_rest(worn)
    force = normal_force(pressed.pressure, worn)
    state = drag_gel(pressed, shift(state, cattaneo(share, worn, force)), state, worn, FRICTION)
    assert state.settled
    assert forces(state, worn) == pytest.approx([share * FRICTION * force, 0], abs=0.002 * FRICTION * force)
    slips = np.hypot(*state.slip) > 0
    sticking = np.sqrt((state.contact & ~slips).sum() * np.prod(worn.pitch) / np.pi) / RADIUS
    assert sticking == pytest.approx((1 - share) ** (1 / 3), abs=0.04)


def test_ball_moves_alike_in_every_direction_and_on_oblong_pixels():
    worn = sensor(48, 48)
    oblong = worn.model_copy(update={"cols": 72})
    along = cattaneo(0.6, worn, normal_force(hertz(worn).pressure, worn))
    expected = None
    for gel, (x, y) in ((worn, (1, 0)), (worn, (0, -1)), (worn, (0.6, 0.8)), (oblong, (1, 0)), (oblong, (0.6, 0.8))):
        rest = gel_at_rest(gel)
        found = forces(drag_gel(hertz(gel), shift(rest, x * along, y * along), rest, gel, FRICTION), gel)
        expected = np.hypot(*found) if expected is None else expected
        assert found == pytest.approx([x * expected, y * expected], abs=0.003 * expected)


@pytest.mark.usefixtures("no_pull")
@pytest.mark.parametrize("steps", [1, 4])
def test_there_and_back_follows_mindlins_cycle(steps):
    """Force half-way back, and the work that a closed cycle costs (Johnson, Contact Mechanics, 1985, 7.4)."""
    worn = sensor(48, 48, 0.3)
    pressed, state, share = hertz(worn), gel_at_rest(worn), 0.7
    force = normal_force(pressed.pressure, worn)
    far, work, path = cattaneo(share, worn, force), 0.0, []
    for goal in (far, -far, far):
        start, loss = (path[-1][0] if path else 0.0), 0.0
        for at in np.linspace(start, goal, steps + 1)[1:]:
            state = drag_gel(pressed, shift(state, at - (path[-1][0] if path else 0.0)), state, worn, FRICTION)
            path.append((at, forces(state, worn)[0]))
            loss += (state.traction * state.slip).sum() * np.prod(worn.pitch)
        work += loss if path[-1][0] != far or len(path) > steps else 0.0
    assert path[2 * steps - 1][1] == pytest.approx(-share * FRICTION * force, abs=0.002 * FRICTION * force)
    assert path[-1][1] == pytest.approx(share * FRICTION * force, abs=0.002 * FRICTION * force)
    power = 1 - (1 - share) ** (5 / 3) - 5 * share / 6 * (1 + (1 - share) ** (2 / 3))
    expected = 9 * 1.7 * (FRICTION * force) ** 2 / (10 * shear_modulus(worn) * RADIUS) * power
    assert work == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("cells", "slipping", "sticking"), [(20, 0.002, 0.04), pytest.param(40, 0.0005, 0.015, marks=pytest.mark.slow)])
def test_twisted_ball_has_the_torque_of_full_slip_and_of_full_stick(cells, slipping, sticking):
    worn = sensor(int(2.4 * cells), int(2.4 * cells), pitch=RADIUS / cells)
    pressed, rest = hertz(worn), gel_at_rest(worn)
    force = normal_force(pressed.pressure, worn)
    slid = drag_gel(pressed, shift(rest, 0, turn=0.9, worn=worn), rest, worn, FRICTION)
    assert torque(slid, worn) == pytest.approx(3 * np.pi / 16 * FRICTION * force * RADIUS, rel=slipping)
    x, y = pixel_centres(worn)
    inside = np.hypot(x[None], y[:, None]) < RADIUS  # no cells of which less than a half touches
    pressed = PressedGel(pressed.indentation, inside, np.where(inside, pressed.pressure, 0))
    stuck = drag_gel(pressed, shift(rest, 0, turn=1e-4, worn=worn), rest, worn, 1000)
    assert torque(stuck, worn) == pytest.approx(16 / 3 * shear_modulus(worn) * RADIUS**3 * 1e-4, rel=sticking)


def test_wide_layer_is_sheared_evenly():
    worn = sensor(100, 100, 0.48, thickness=RADIUS / 10)
    x, y = pixel_centres(worn)
    pressure = np.where((abs(x[None]) < RADIUS) & (abs(y[:, None]) < RADIUS), 1e4, 0.0)
    rest = gel_at_rest(worn)
    state = drag_gel(PressedGel(pressure, pressure > 0, pressure), shift(rest, 1e-6), rest, worn, 1000)
    assert state.traction[0, 50, 50] == pytest.approx(shear_modulus(worn) * 1e-6 / (RADIUS / 10), rel=2e-3)
    assert abs(state.traction[1, 50, 50]) < 1e-3 * state.traction[0, 50, 50]


def test_step_equals_the_slow_solver(rng):
    for poisson, thickness, coefficient in ((0.3, 0.0005, 0.2), (0.48, 0.002, 0.7), (0.5, 0.0003, 1.5)):
        worn = sensor(10, 11, poisson, thickness, RADIUS / 4)
        pressed, state = hertz(worn), gel_at_rest(worn)
        stiff = E / (1 - poisson**2)
        for _ in range(2):
            motion = shift(state, *rng.normal(size=2) * 3e-5, turn=0.02 * rng.normal(), worn=worn)
            target = state.anchor + motion[:2]
            state = drag_gel(pressed, motion, state, worn, coefficient)
            slow, moved = slow_drag(pressed.pressure / stiff, target, coefficient, worn.pitch, poisson, thickness)
            assert abs(state.traction - slow * stiff).max() < 5e-3 * abs(slow * stiff).max()
            assert abs(state.displacement - moved).max() < 1e-3 * abs(moved).max()
            assert forces(state, worn) == pytest.approx(slow.sum(axis=(1, 2)) * stiff * np.prod(worn.pitch), rel=1e-3, abs=1e-6)


def test_stick_is_linear_and_mirrored_paths_give_mirrored_fields():
    worn = sensor(48, 48, 0.3, 0.002)
    pressed, rest = hertz(worn), gel_at_rest(worn)
    pulled = drag_gel(pressed, shift(rest, 0), rest, worn, 1000)
    once, twice = (drag_gel(pressed, shift(rest, k * 2e-6, k * 1e-6), rest, worn, 1000) for k in (1, 2))
    np.testing.assert_allclose(twice.traction - pulled.traction, 2 * (once.traction - pulled.traction), atol=2e-3 * once.traction.max())
    one = drag_gel(pressed, shift(rest, 6e-5, 3e-5), rest, worn, FRICTION)
    mirrored = drag_gel(pressed, shift(rest, -6e-5, 3e-5), rest, worn, FRICTION)
    for name in ("traction", "displacement", "slip"):
        there, here = getattr(mirrored, name), getattr(one, name)
        np.testing.assert_allclose(there[0, :, ::-1], -here[0], atol=1e-4 * abs(here).max())
        np.testing.assert_allclose(there[1, :, ::-1], here[1], atol=1e-4 * abs(here).max())


def test_sliding_needs_friction_times_normal_force_and_holding_does_not_slip():
    worn = sensor(48, 48, 0.3, 0.003)
    pressed, state = hertz(worn), gel_at_rest(worn)
    limit = FRICTION * normal_force(pressed.pressure, worn)
    for _ in range(8):
        state = drag_gel(pressed, shift(state, 1e-4), state, worn, FRICTION)
    assert forces(state, worn) == pytest.approx([limit, 0], rel=1e-3, abs=1e-3 * limit)
    assert (np.hypot(*state.slip) > 0)[state.contact].all()
    held = drag_gel(pressed, shift(state, 0), state, worn, FRICTION)
    assert not held.slip.any()
    np.testing.assert_allclose(held.traction, state.traction, atol=1e-3 * abs(state.traction).max())


@pytest.mark.parametrize("coefficient", [0.0, 1e-12])
def test_without_friction_only_pressure_displaces(coefficient):
    worn = sensor(48, 48, 0.0, 0.002)
    rest = gel_at_rest(worn)
    state = drag_gel(hertz(worn), shift(rest, 1e-4), rest, worn, coefficient)
    assert not state.traction.any()
    assert state.displacement[0, 24, 34] < 0 < state.displacement[0, 24, 14]  # towards the load
    assert (np.hypot(*state.slip) > 5e-5)[state.contact].all()


@pytest.mark.parametrize("coefficient", [1e-6, 1e-3, 10, 1000])
@pytest.mark.parametrize("travel", [1e-9, 1e-3])
def test_any_friction_and_travel_settles(coefficient, travel):
    worn = sensor(40, 48, 0.48, 0.002)
    pressed, state = hertz(worn), gel_at_rest(worn)
    for _ in range(3):
        state = drag_gel(pressed, shift(state, travel), state, worn, coefficient)
        assert state.settled
    assert (np.hypot(*state.traction) <= coefficient * pressed.pressure * (1 + 1e-5)).all()


def test_gel_that_is_let_go_returns_to_rest():
    worn = sensor(48, 48)
    rest, nothing = gel_at_rest(worn), PressedGel(np.zeros((48, 48)), np.zeros((48, 48), bool), np.zeros((48, 48)))
    first = drag_gel(hertz(worn), shift(rest, 5e-5), rest, worn, FRICTION)
    gone = drag_gel(nothing, shift(first, 5e-5), first, worn, FRICTION)
    assert not any(array.any() for array in gone[:5])
    again = drag_gel(hertz(worn), shift(gone, 5e-5), gone, worn, FRICTION)
    np.testing.assert_array_equal(again.traction, first.traction)


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "poisson", "share"), [(0.7, 0.3, 0.01), (0.7, 0.5, 0.02), (1.5, 0.48, 0.1), (1.5, 0.5, 0.18)])
def test_normal_force_errs_by_what_traction_lifts_the_surface(ratio, poisson, share):
    """Press a ball until its contact's radius is a ratio of the thickness, with the pressure iterated for the traction, and without."""
    worn = sensor(64, 64, poisson, RADIUS / ratio)
    x, y = pixel_centres(worn)
    offset, quarters = np.arange(1 - 64, 64), shear_influence((64, 64), worn.pitch, poisson, worn.layer_thickness)
    pull = [
        np.where(offset < 0, along_y, 1)[:, None] * np.where(offset < 0, along_x, 1) * quarter[np.ix_(abs(offset), abs(offset))]
        for quarter, (along_y, along_x) in zip(quarters[3:], MIRRORED[3:], strict=True)
    ]
    depth = 1e-4
    for _ in range(8):  # the area grows as the depth
        below = depth - (x[None] ** 2 + y[:, None] ** 2) / 0.02
        alone = press_elastic(np.maximum(below, 0), worn, worn.gel)
        depth *= np.pi * RADIUS**2 / (alone.contact.sum() * np.prod(worn.pitch))
    state, lifted = gel_at_rest(worn), 0.0
    for growth in (0.25, 0.5, 0.75, 1, 1, 1):
        pressed = press_elastic(np.maximum(below + (growth - 1) * below.max() + lifted, 0), worn, worn.gel)
        state = drag_gel(pressed, shift(state, 0), state, worn, FRICTION)
        lifted = sum(fftconvolve(kernel, part, "valid") for kernel, part in zip(pull, state.traction, strict=True)) * (1 - poisson**2) / E
    assert pressed.pressure.sum() / alone.pressure.sum() - 1 == pytest.approx(share, abs=0.3 * share + 0.003)


def test_finer_steps_change_little():
    """Press, slide by 0.1 mm, twist by 0.1 rad, in 4 and in 32 steps each."""
    worn, results = sensor(48, 48, 0.48, 0.002), []
    for steps in (4, 32):
        state = gel_at_rest(worn)
        for k in range(steps):
            grown = ((k + 1) / steps) ** (1 / 3)
            state = drag_gel(hertz(worn, RADIUS * grown, 2e4 * grown), shift(state, 0), state, worn, FRICTION)
        for _ in range(steps):
            state = drag_gel(hertz(worn), shift(state, 1e-4 / steps), state, worn, FRICTION)
        slid = forces(state, worn)[0]
        for _ in range(steps):
            state = drag_gel(hertz(worn), shift(state, 0, turn=0.1 / steps, worn=worn), state, worn, FRICTION)
        results.append([slid, forces(state, worn)[0], torque(state, worn)])
    assert results[0] == pytest.approx(results[1], rel=0.02)


@pytest.mark.parametrize("number", [*range(20), *(pytest.param(number, marks=pytest.mark.slow) for number in range(20, 170))])
def test_random_steps_settle_and_dissipate(number):
    """Six steps of a random shape on a random gel, from a cell to 10 m thick."""
    rng = np.random.default_rng(number)
    rows, cols = [(48, 48), (24, 120), (36, 48), (120, 20), (60, 60)][number % 5]
    pitch = 0.018 / cols
    worn = sensor(rows, cols, rng.choice([0.0, 0.3, 0.48, 0.5]), max(1.01 * pitch, rng.choice([3e-4, 1e-3, 3e-3, 0.01, 10])), pitch)
    coefficient, state = 10 ** rng.uniform(-3, 1), gel_at_rest(worn)
    depth = random_press(worn, rng, PressRanges(size=(0.0005, 0.01), depth=(1e-5, 0.0012), tilt=0.3)).depth
    top = (worn.w - depth).max()
    for _ in range(6):
        pressed = press_gel(depth + top * rng.uniform(0, 0.5), worn)
        motion = shift(state, *10 ** rng.uniform(-9, -3) * rng.normal(size=2), 10 ** rng.uniform(-5, -1) * rng.normal(), worn)
        motion *= min(1, 0.9 * worn.layer_thickness / np.hypot(*motion[:2]).max())
        state = drag_gel(pressed, motion, state, worn, coefficient)
        assert state.settled
        assert np.isfinite(state.displacement).all()
        assert ((state.traction * state.slip).sum(axis=0) >= 0).all()


def test_step_that_does_not_settle_says_so(monkeypatch):
    monkeypatch.setattr(friction, "MAX_STEPS", 1)
    worn = sensor(48, 48)
    rest = gel_at_rest(worn)
    assert not drag_gel(hertz(worn), shift(rest, 5e-5), rest, worn, FRICTION).settled


def test_motion_beyond_the_thickness_is_refused_while_the_object_touches():
    worn = sensor(48, 48, thickness=0.001)
    rest, nothing = gel_at_rest(worn), PressedGel(np.zeros((48, 48)), np.zeros((48, 48), bool), np.zeros((48, 48)))
    assert drag_gel(nothing, shift(rest, 0.0011), rest, worn, FRICTION).settled
    touching = drag_gel(hertz(worn), shift(rest, 0.0009), rest, worn, FRICTION)
    for pressed, before in ((hertz(worn), rest), (nothing, touching)):
        with pytest.raises(InvalidInput, match=r"moves by 0\.0011 m .* 'gelsight' .* the gel's thickness, 0\.001 m: add"):
            drag_gel(pressed, shift(rest, 0.0011), before, worn, FRICTION)


def test_motion_is_that_of_the_points_over_the_cells(rng):
    """Points of a tilted plane, followed in the object's frame; 2 x 2 pixels share a cell."""
    worn = sensor(180, 320, pitch=1e-4)
    x, y = np.meshgrid(*pixel_centres(worn))
    depth = 0.0055 + 0.01 * x + 0.02 * y  # everywhere in the gel
    before, now = np.eye(4), np.eye(4)
    before[:3, :3], before[:3, 3] = frame(rng.normal(size=3)), rng.normal(size=3)
    now[:3, :3], now[:3, 3] = before[:3, :3] @ frame(np.array([0.02, -0.01, 1]), 0.03), before[:3, 3] + 1e-4
    motion = object_motion(depth, before, now, worn)
    assert motion.shape == (3, 90, 160)
    points = np.stack([x, y, depth, np.ones_like(x)])
    expected = points - np.tensordot(np.linalg.inv(before) @ now, points, 1)
    np.testing.assert_allclose(motion, expected[:3].reshape(3, 90, 2, 160, 2).mean(axis=(2, 4)), atol=1e-12)
    assert np.isfinite(object_motion(np.full(worn.shape, np.inf), before, now, worn)).all()


def test_pixels_of_a_cell_share_its_direction_and_keep_its_force():
    worn = sensor(181, 320, 0.48, 0.002, RADIUS / 60)  # the last row of cells is cut
    x, y = np.meshgrid(*pixel_centres(worn))
    pressed, state = press_gel(worn.w - np.maximum(3e-4 - (x**2 + y**2) / 0.02, 0), worn), gel_at_rest(worn)
    state = drag_gel(pressed, shift(state, 4e-5, 2e-5), state, worn, FRICTION)
    traction = surface_traction(state, pressed, worn)
    assert traction.sum(axis=(0, 1)) * np.prod(worn.pitch) == pytest.approx(forces(state, worn), rel=1e-6)
    assert (np.hypot(*np.moveaxis(traction, -1, 0)) <= FRICTION * pressed.pressure * (1 + 1e-5)).all()
    displacement = surface_displacement(state, worn)
    assert displacement.shape == (181, 320, 2)
    assert displacement[80:100:2, 100:220:2].mean(axis=(0, 1)) == pytest.approx(
        state.displacement[:, 40:50, 50:110].mean(axis=(1, 2)), rel=0.05
    )
    np.testing.assert_array_equal(on_pixels(state.slip, worn)[::2, ::2, 0], state.slip[0])
