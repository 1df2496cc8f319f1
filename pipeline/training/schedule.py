"""Schedules of the learning rate."""

import math
from typing import Literal

Schedule = Literal["constant", "cosine"]

WARM_UP = 0.05
"""Share of all steps in which a cosine schedule rises to the full rate, while Adam has seen few gradients."""


def rate_at(step: int, steps: int, schedule: Schedule) -> float:
    """Compute the share of the learning rate at a step, which counts from 0.

    `constant` is 1; `cosine` rises linearly, then falls along half a cosine to nearly 0.
    """
    if schedule == "constant":
        return 1.0
    rising = max(1, round(WARM_UP * steps))
    if step < rising:
        return (step + 1) / rising
    return (1 + math.cos(math.pi * (step - rising) / max(1, steps - rising))) / 2
