"""Mixed precision for networks that compute geometry; imported by a training alone, as Lightning Fabric takes seconds to import."""

from typing import Any

from lightning_fabric.plugins.precision.amp import MixedPrecision


class MixedPrecisionLayers(MixedPrecision):
    """Autocast a network's layers and keep its inputs: in bfloat16 a point of the scene is rounded by millimetres."""

    def convert_input(self, data: Any) -> Any:
        """Return the inputs."""
        return data
