"""An elastic gel against closed forms (Hertz's ball and cylinder, a flat punch, a thin layer) and against a dense slow solver."""

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch import elastic_contact
from pipeline.kernels.touch.depth_maps import normal_force, press_gel
from pipeline.kernels.touch.elastic_contact import press_elastic
from pipeline.kernels.touch.elastic_layer import layer_factor
from pipeline.kernels.touch.press_shapes import PressRanges, press_relief, random_press
from pipeline.kernels.touch.sensor import Gel, Sensor, pixel_centres
from tests.references.slow_elastic_gel import repeated, slow_press, slow_refine, slow_spread

SIDE, E, POISSON = 0.018, 2e5, 0.48
STIFF = E / (1 - POISSON**2)
HALF_SPACE = Gel(modulus=E, poisson=POISSON, thickness=10.0)
"""10 m of rubber under 2 cm of sensor."""


def sensor(rows: int, cols: int, gel: Gel | None = HALF_SPACE, side: float = SIDE) -> Sensor:
    """Square pixels, `side` long along x."""
    size = {"width": side, "given_height": side * rows / cols, "rows": rows, "cols": cols}
    return load_sensor("gelsight").model_copy(update=size | {"w": 0.006, "membrane": 0.0, "gel": gel})


def radii(worn: Sensor) -> np.ndarray:
    x, y = pixel_centres(worn)
    return np.hypot(x[None], y[:, None])


@pytest.mark.parametrize("shape", [(120, 160), (240, 320)])
@pytest.mark.parametrize(("radius", "depth"), [(0.004, 0.0004), (0.006, 0.0005), (0.003, 0.0008)])
def test_ball_follows_hertz(shape, radius, depth):
    """Force, radius of the contact, pressure and the surface around it, for one pixel per cell and for several."""
    worn = sensor(*shape)
    distance = radii(worn)
    gel = press_elastic(np.maximum(depth - distance**2 / (2 * radius), 0), worn, HALF_SPACE)
    contact, peak = np.sqrt(radius * depth), 2 * STIFF / np.pi * np.sqrt(depth / radius)
    force, area = normal_force(gel.pressure, worn), (gel.pressure > 0).sum() * np.prod(worn.pitch)
    assert force == pytest.approx(4 / 3 * STIFF * np.sqrt(radius) * depth**1.5, rel=0.002)
    assert np.sqrt(area / np.pi) == pytest.approx(contact, rel=0.02)
    assert gel.pressure.max() == pytest.approx(peak, rel=0.005)
    around = (distance > contact) & (distance < 4 * contact)
    r = distance[around]
    skirt = ((2 * contact**2 - r**2) * np.arcsin(contact / r) + contact * np.sqrt(r**2 - contact**2)) / (np.pi * radius)
    assert np.abs(gel.indentation[around] - skirt).max() < 0.01 * depth
    inside = distance < 0.9 * contact
    assert np.abs(gel.indentation - (depth - distance**2 / (2 * radius)))[inside].max() < 2e-4 * depth  # its mean square is below 1e-4
    hertz = peak * np.sqrt(np.maximum(1 - (distance / contact) ** 2, 0))
    assert np.abs(gel.pressure - hertz)[inside].max() < 0.03 * peak


@pytest.mark.parametrize(("ratio", "soft", "rubber"), [(0.2, 1.207, 1.281), (0.6, 1.784, 2.211), (1, 2.480, 3.609), (2, 4.336, 9.069)])
def test_force_of_a_flat_punch_on_a_layer_equals_published_values(ratio, soft, rubber):
    """2 E* a d times the table of Hayes, Keer, Herrmann and Mockros 1972, by the punch's radius over the layer's thickness."""
    punch, depth = 0.0045, 1e-4
    for poisson, factor in ((0.3, soft), (0.5, rubber)):
        layer = Gel(modulus=E, poisson=poisson, thickness=punch / ratio)
        worn = sensor(160, 160, layer)
        gel = press_elastic(np.where(radii(worn) < punch, depth, 0), worn, layer)
        assert normal_force(gel.pressure, worn) == pytest.approx(factor * 2 * E / (1 - poisson**2) * punch * depth, rel=0.01)


def test_compliance_of_a_layer_has_the_limits_of_short_and_long_waves():
    long = np.array([1e-3])
    for poisson in (0.0, 0.3, 0.48):
        assert layer_factor(np.array([20.0]), poisson) == pytest.approx(1, abs=1e-12)
        winkler = long * (1 - 2 * poisson) / (2 * (1 - poisson) ** 2)
        assert layer_factor(long, poisson) == pytest.approx(winkler, rel=1e-3)
    assert layer_factor(long, 0.5) == pytest.approx(2 / 3 * long**3, rel=1e-3)  # rubber that nothing compresses: only squeezed aside


@pytest.mark.parametrize("gel", [HALF_SPACE, Gel(modulus=E, poisson=0.3, thickness=0.002), Gel(modulus=E, poisson=0.5, thickness=0.004)])
def test_press_equals_the_slow_solver(gel, rng):
    worn = sensor(9, 12, gel)
    for shape in ("ball", "prism", "relief"):
        pressed = np.maximum(worn.w - random_press(worn, rng, shapes=[shape]).depth, 0)
        gel_state = press_elastic(pressed, worn, gel)
        slow, pressure = slow_press(pressed, worn.pitch, modulus=gel.modulus, poisson=gel.poisson, thickness=gel.thickness)
        assert np.abs(gel_state.pressure - pressure).max() < 1e-3 * pressure.max()
        assert gel_state.pressure.sum() == pytest.approx(pressure.sum(), rel=5e-4)
        assert np.abs(gel_state.indentation - slow).max() < 2e-4 * pressed.max()


@pytest.mark.parametrize(("cells", "factor"), [((1, 7), 3), ((2, 2), 2), ((3, 1), 4), ((20, 30), 3)])
def test_pixels_of_a_cell_get_the_surface_and_pressure_of_slow_interpolation(cells, factor, rng):
    shape = (cells[0] * factor - 1, cells[1] * factor)  # the last row of cells is cut
    surface = rng.normal(size=cells)
    np.testing.assert_allclose(elastic_contact.refine(surface, factor, shape), slow_refine(surface, factor, shape), atol=1e-12)
    pressed = (repeated(surface, factor)[: shape[0], : shape[1]] > 0) & (rng.random(shape) < 0.7)
    means = np.add.reduceat(np.add.reduceat(pressed, range(0, shape[0], factor), axis=0), range(0, shape[1], factor), axis=1)
    pressure = np.where(means > 0, surface, 0)
    spread = elastic_contact._spread(pressure, factor, pressed.astype(float))
    np.testing.assert_allclose(spread, slow_spread(pressure, pressed, factor), atol=1e-12)


@pytest.mark.parametrize("number", range(40))
def test_contact_settles_in_any_gel(number):
    """Layers from a cell to a metre thick, compressible or not; the thinnest of rubber need most steps."""
    rng = np.random.default_rng(number)
    shape = [(64, 64), (24, 160), (48, 64), (160, 20)][number % 4]
    cell = SIDE / shape[1]
    gel = Gel(modulus=E, poisson=rng.choice([0.0, 0.3, 0.5]), thickness=float(cell * rng.choice([1.01, 2, 4, 30, 10000])))
    worn = sensor(*shape, gel)
    state = press_gel(random_press(worn, rng, PressRanges(size=(0.0005, 0.02), depth=(1e-6, 0.005), tilt=0.3)).depth, worn)
    assert state.contact.any()
    assert np.isfinite(state.indentation).all()


@pytest.mark.parametrize("number", range(30))
def test_force_grows_with_depth(number):
    """Press a random shape into a random gel at three depths; the force grows by at least half as much as the depth."""
    rng = np.random.default_rng(number)
    gel = Gel(modulus=10 ** rng.uniform(4, 6), poisson=rng.choice([0.0, 0.3, 0.48, 0.5]), thickness=rng.choice([0.001, 0.004, 0.01, 10.0]))
    worn = sensor(*[(100, 100), (120, 160), (240, 320)][number % 3], gel)
    press = random_press(worn, rng)
    deepest = float((worn.w - press.depth).max())
    relief = np.where(np.isfinite(press.depth), -press.depth, -np.inf)
    gels = [press_gel(press_relief(relief, worn, share * deepest), worn) for share in (0.9, 0.96, 1.0)]
    forces = [normal_force(gel_state.pressure, worn) for gel_state in gels]
    assert forces[0] > 0
    assert (np.diff(forces) / forces[:-1] > 0.5 * np.array([0.06 / 0.9, 0.04 / 0.96])).all()
    for gel_state in gels:
        assert np.isfinite(gel_state.indentation).all()
        assert (gel_state.pressure >= 0).all()
        assert (gel_state.contact == (gel_state.pressure > 0)).all()


def test_depth_without_contact_gives_zero_force_and_indentation():
    worn = sensor(100, 120)
    gel = press_gel(np.full(worn.shape, np.inf), worn)
    assert not gel.contact.any()
    assert normal_force(gel.pressure, worn) == 0
    assert (gel.indentation == 0).all()


def test_gel_thinner_than_a_pixel_is_refused():
    thin = Gel(modulus=E, thickness=1e-5)
    with pytest.raises(InvalidInput, match=r"1e-05 m thick, its contact is solved on cells of 0.00018 m: make the gel at least as thick"):
        press_elastic(np.full((60, 100), 1e-4), sensor(60, 100, thin), thin)


def test_a_sensor_has_either_a_membrane_or_an_elastic_gel():
    described = load_sensor("gel_16mm").model_dump(mode="json", exclude_none=True)
    assert "gel" not in load_sensor("gel_16mm").model_dump(mode="json")  # as before there were any
    assert Sensor.model_validate(described | {"gel": {"modulus": 2e5}}).gel == Gel(modulus=2e5)
    with pytest.raises(ValueError, match=r"a membrane of 0\.001 m and an elastic gel"):
        Sensor.model_validate(described | {"membrane": 0.001, "gel": {"modulus": 2e5}})
    with pytest.raises(ValueError, match="modulus"):
        Sensor.model_validate(described | {"gel": {"poisson": 0.3}})
