"""Every artifact by name, in the order in which they are made."""

from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION

ARTIFACTS = {artifact.name: artifact for artifact in (SURFACES, GRASPS, VISION, TOUCH)}
