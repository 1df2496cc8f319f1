"""Measurements of depth maps."""

import numpy as np


def deepest(depth: np.ndarray, thickness: float, least: float) -> np.ndarray:
    """Measure how deep (…, row, col) depth maps, m, press into a gel of this thickness; 0 where that is less than `least`."""
    press = np.maximum(thickness - depth.min(axis=(-2, -1)), 0)
    return np.where(press < least, 0, press).astype(np.float32)
