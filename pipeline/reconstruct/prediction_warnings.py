"""Warn of predictions that deserve less trust than the network's error says."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pipeline.models.learned_view import has_learned_view
from pipeline.models.observation import Observation
from pipeline.models.reconstruction import Reconstruction, Reconstructor
from pipeline.reconstruct.observation_file import RobotObservation


def unseen_touches(observed: RobotObservation, touched: NDArray[np.bool_]) -> Iterator[str]:
    """Warn of touches that the observation states, and whose tactile images show none."""
    names = [observed.name_of(n) for n, touch in enumerate(observed.touches) if touch.touched is True and len(touched) and not touched[n]]
    if names:
        yield f"warning: {', '.join(names)}: touched: true, but the tactile image shows no contact, so no touch is given"


def guessed_surface_warning(reconstruction: Reconstruction) -> Iterator[str]:
    """Warn of a surface around the likeliest point, because the network finds none inside the object."""
    if reconstruction.is_guess:
        yield "warning: the network finds no point inside the object; the surface is a speck around the likeliest one"


def view_warning(model: Reconstructor, seen: Observation) -> Iterator[str]:
    """Warn of an image that is not from the camera of the training: it is given as it is."""
    camera = seen.scaled(model.config.centre).camera
    if camera is not None and model.camera is not None and not has_learned_view(model, camera):
        yield "warning: the image is from another camera than the network's training; errors are larger than measured"
