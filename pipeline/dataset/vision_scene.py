"""The scene of a dataset's images, as the root of its vision artifact describes it.

A separate module, so that what reads touches, and its keys, do not depend on cameras.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.kernels.vision.scene import Scene


def dataset_scene(attributes: Mapping[str, Any]) -> Scene:
    """Read the scene from the attributes of a `vision` group's root, whatever became of its file; a `ValidationError` if there is none."""
    return Scene.model_validate(attributes.get("scene"))
