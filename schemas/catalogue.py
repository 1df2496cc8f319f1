"""Every artifact by name, in the order in which they are made."""

from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION

ARTIFACTS = {artifact.name: artifact for artifact in (SURFACES, GRASPS, VISION, TOUCH, CHARTS)}


def artifact_of(array: str) -> Artifact:
    """The artifact that has an array of this name; a `KeyError` that lists all names where there is none."""
    for artifact in ARTIFACTS.values():
        if array in artifact.arrays:
            return artifact
    known = sorted({name for artifact in ARTIFACTS.values() for name in artifact.arrays})
    raise KeyError(f"no artifact has an array {array}; there are {', '.join(known)}")
