"""The knobs of `train-gcn`."""

from pydantic import field_validator

from pipeline.kernels.learning.configurations import CONFIGURATIONS, NetworkConfig
from pipeline.learning.settings import TrainingSettings
from pipeline.settings import knob


class GcnSettings(TrainingSettings):
    """How vision charts learn to close in on the object (supplement 3.1-3.4)."""

    configuration: str = knob("occluded-touch", f"which of the supplement's networks: {', '.join(CONFIGURATIONS)}")
    gcn_layers: int | None = knob(8, "for trainings of minutes on a CPU; null is the table's 15 to 25", ge=2)
    gcn_features: int | None = knob(96, "likewise; null is the table's 200 or 250", ge=3)
    encoder_layers: int | None = knob(None, "the table's; 12, 15 or 18 of 3.4's grid", ge=1)
    encoder_kernel: int = knob(3, "as the tables print; 5, padded by 1, gives the same sizes and is what was released", ge=3, le=5)
    encoder_width: float = knob(0.5, "share of the tables' channels, likewise", gt=0, le=2)
    mixed: float = knob(1 / 3, "share of features averaged over neighbours; the cited work has 1/10 as well", ge=0, le=1)
    passes: int = knob(3, "times the charts are deformed, with the same weights", ge=1)
    learning_rate: float = knob(3e-4, "ten times the supplement's, for trainings a hundred times shorter", gt=0)
    batch_size: int = knob(16, "the supplement's", ge=1)
    epochs: int = knob(30, "minutes on a CPU; the supplement has 260", ge=1)
    patience: int | None = knob(70, "the supplement's", ge=1)
    min_grasps: int = knob(1, "fewest grasps an item is given; how many, between fewest and most, is drawn for every item", ge=1)
    max_grasps: int = knob(5, "most grasps", ge=1)
    items: int = knob(5, "items an object an epoch, each beginning with another grasp, whether a network feels or not", ge=1)
    validation_items: int = knob(5, "items a validation object, with 1, 2, … grasps", ge=1)
    loss_points: int = knob(3000, "points sampled on the prediction and drawn from the object's for the loss", ge=1)
    checkpoint_passes: bool = knob(
        False, "recompute each pass in the backward one: a third of the memory, a third more time", changes="speed"
    )

    @field_validator("configuration")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in CONFIGURATIONS:
            raise ValueError(f"{name} is none of {', '.join(CONFIGURATIONS)}")
        return name

    def network(self, side: int) -> NetworkConfig:
        """The network these settings describe, for touch charts of side x side vertices."""
        named = CONFIGURATIONS[self.configuration]
        changes = {
            "gcn_layers": self.gcn_layers,
            "gcn_features": self.gcn_features,
            "encoder_layers": self.encoder_layers,
        }
        changed = {name: value for name, value in changes.items() if value is not None}
        return named.model_copy(
            update=changed
            | {
                "encoder_kernel": self.encoder_kernel,
                "encoder_width": self.encoder_width,
                "mixed": self.mixed,
                "passes": self.passes,
                "side": side,
                "checkpointing": self.checkpoint_passes,
            }
        )
