"""Read the scene of a dataset's images from the root of its vision artifact.

A separate module, so that what reads touches, and its keys, do not depend on cameras.
"""

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from pipeline.errors import StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.kernels.vision.scene import Scene


def dataset_scene(attributes: Mapping[str, Any]) -> Scene:
    """Read the scene from the attributes of a `vision` group's root, whatever became of its file; a `StoreError` if it cannot be used."""
    try:
        return Scene.model_validate(attributes.get("scene"))
    except ValidationError as error:
        faults = invalid_entries(error)
        raise StoreError(
            f"the scene that `vision` records cannot be used ({faults}); delete `vision` and run render-vision again"
        ) from error
