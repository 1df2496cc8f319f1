"""`measure-press`: measure how deep each touch presses into the gel."""

from typing import ClassVar

from pipeline.config.settings import ObjectSettings, setting
from pipeline.dataset.object_rows import sensor_of
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Unit
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.touch import TOUCH

from .measurements import deepest
from .schema import PRESS


class PressSettings(ObjectSettings):
    """Settings of `measure-press`, with their values in presets."""

    presets: ClassVar = {"paper": {"least": 1e-4}}

    least: float = setting(0.0, "m, a shallower press counts as none; noisy depth needs more than 0", ge=0)


class MeasurePress(ObjectStage):
    """Measure how deep each touch presses in."""

    name = "measure-press"
    summary = "How deep each touch presses into the gel."
    output = PRESS
    settings_type = PressSettings

    def inputs(self, settings: PressSettings) -> tuple[Artifact, ...]:
        """Return the artifact with the depth maps."""
        return (TOUCH,)

    def cost(self, settings: PressSettings) -> Cost:
        """Estimate time and size per object."""
        return Cost(seconds=0.01, kilobytes=1)

    def process(self, unit: Unit, inputs: Inputs, settings: PressSettings) -> Row:
        """Make an object's row."""
        touch = inputs["touch"]
        return {"press": deepest(touch["depth"], sensor_of(touch.shard).w, settings.least)}
