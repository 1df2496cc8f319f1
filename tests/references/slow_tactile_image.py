"""The tactile image, equations 1 to 5 transcribed pixel by pixel."""

import numpy as np

from pipeline.kernels.touch.sensor import Sensor
from tests.references.gel_heights import gel_heights


def slow_tactile_image(depth: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Equations 1 to 5, transcribed pixel by pixel; the surface is the lower of object and gel."""
    rows, cols = depth.shape
    aspect = sensor.height / sensor.width
    gel = gel_heights(sensor)
    pressed = [[max(gel[r, c] - float(depth[r, c]), 0.0) for c in range(cols)] for r in range(rows)]  # equation 1
    z = [[(sensor.w - gel[r, c] + pressed[r][c]) / sensor.width for c in range(cols)] for r in range(rows)]  # in sensor widths
    image = np.zeros((rows, cols, 3), np.uint8)
    for r in range(rows):
        for c in range(cols):
            left, right = max(c - 1, 0), min(c + 1, cols - 1)
            above, below = max(r - 1, 0), min(r + 1, rows - 1)
            d_dx = (z[r][right] - z[r][left]) / ((right - left) / cols)
            d_dy = (z[below][c] - z[above][c]) / ((below - above) / rows * aspect)
            n = np.array([-d_dx, -d_dy, 1.0])  # equation 3
            n_hat = n / np.linalg.norm(n)  # equation 4
            s = np.array([(c + 0.5) / cols, (r + 0.5) / rows * aspect, z[r][c]])
            for channel, lamp in enumerate((sensor.lights.red, sensor.lights.green, sensor.lights.blue)):
                to_lamp = np.array(lamp) - s
                l_hat = to_lamp / np.linalg.norm(to_lamp)  # equation 5
                intensity = sensor.diffuse * float(n_hat @ l_hat)  # equation 2
                image[r, c, channel] = round(min(max(intensity, 0.0), 1.0) * 255)
    return image
