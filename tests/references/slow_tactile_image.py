"""The tactile image, equations 1 to 5 transcribed pixel by pixel."""

from __future__ import annotations

import numpy as np


def slow_tactile_image(depth: np.ndarray, width: float, w: float, diffuse: float, lamps: list[tuple[float, float, float]]) -> np.ndarray:
    """Equations 1 to 5, transcribed pixel by pixel."""
    rows, cols = depth.shape
    height = [[max(w - float(d), 0.0) / width for d in row] for row in depth]  # equation 1, in sensor widths
    image = np.zeros((rows, cols, 3), np.uint8)
    for r in range(rows):
        for c in range(cols):
            left, right = max(c - 1, 0), min(c + 1, cols - 1)
            above, below = max(r - 1, 0), min(r + 1, rows - 1)
            d_dx = (height[r][right] - height[r][left]) / ((right - left) / cols)
            d_dy = (height[below][c] - height[above][c]) / ((below - above) / rows)
            n = np.array([-d_dx, -d_dy, 1.0])  # equation 3
            n_hat = n / np.linalg.norm(n)  # equation 4
            s = np.array([(c + 0.5) / cols, (r + 0.5) / rows, height[r][c]])
            for channel, lamp in enumerate(lamps):
                to_lamp = np.array(lamp) - s
                l_hat = to_lamp / np.linalg.norm(to_lamp)  # equation 5
                intensity = diffuse * float(n_hat @ l_hat)  # equation 2
                image[r, c, channel] = round(min(max(intensity, 0.0), 1.0) * 255)
    return image
