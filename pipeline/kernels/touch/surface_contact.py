"""Find where an object touches a gel from the gel's surface alone: where the surface is pressed, and not where it is drawn in.

Valid range: surfaces that are read to a tenth of a millimetre. Within 1.5 mm of a hard press, one of a third of its pressure is not seen,
and elsewhere one of a seventh.
"""

from functools import lru_cache

import numpy as np
import scipy
from scipy.ndimage import gaussian_filter, maximum_filter

from pipeline.kernels.arrays import Array
from pipeline.kernels.touch.elastic_layer import layer_factor

POISSON = 0.3  # of the gel: nearer to 0.5, slow errors of the surface become pressure
BLUR = 1.2e-4  # m, standard deviation by which the surface is smoothed: pressure sharpens noise
PRESSED = 0.04  # pressure over the plane-strain modulus from which a pixel may touch: errors of the surface make less
SHARE, NEAR, MEAN = 0.35, 3e-3, 5e-4
"""Least share of the greatest pressure in a square of side `NEAR`, m, of the mean over `MEAN`, m: a gel that falls off otherwise than the
elastic layer shows some pressure around a contact. Chosen by simulated presses: random ones, and balls in gels of other kinds."""
ANYWHERE = 0.15  # least share of the greatest pressure anywhere: beside a hard press, drifting light looks like a gentle one


def contact_margin(
    indentation: Array,  # (rows, cols) m, of the gel's surface below its rest
    pitch: tuple[float, float],  # size of a pixel along y and x, m
    thickness: float,  # of the elastic layer, m
) -> Array:  # (rows, cols) over the plane-strain modulus
    """Compute the pressure on an elastic layer with this surface, less that from which a pixel touches: positive in the contact."""
    pressure = scipy.fft.idctn(scipy.fft.dctn(indentation) * _stiffness(indentation.shape, pitch, thickness))
    mean = gaussian_filter(np.maximum(pressure, 0), [MEAN / size for size in pitch])
    greatest = maximum_filter(mean, [int(NEAR / size) | 1 for size in pitch])
    return np.asarray(pressure - np.maximum(SHARE * greatest, max(PRESSED, ANYWHERE * float(mean.max()))))


@lru_cache(maxsize=8)
def _stiffness(shape: tuple[int, int], pitch: tuple[float, float], thickness: float) -> Array:  # (rows, cols) 1/m
    """Compute the pressure per displacement of waves on a layer that goes on beyond the image as in a mirror, smoothed."""
    y, x = (np.pi * np.arange(count) / (count * size) for count, size in zip(shape, pitch, strict=True))
    wave = np.hypot(y[:, None], x[None])
    wave[0, 0] = wave[0, 1] / 2  # a single contact is not infinite
    return np.asarray(wave / (2 * layer_factor(wave * thickness, POISSON)) * np.exp(-np.square(BLUR * wave) / 2))
