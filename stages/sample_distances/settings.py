"""The settings of `sample-distances`."""

from pydantic import model_validator

from pipeline.config.settings import ObjectSettings, setting


class DistanceSettings(ObjectSettings):
    """The points at which distances to the surface are recorded; lengths are for objects of 0.5 m, and in proportion for others."""

    queries: int = setting(16_384, "points per object; a training draws some hundreds of them at a time", gt=0)
    near: float = setting(0.75, "share of the points that are near the surface, where a network's answer decides on its shape", ge=0, le=1)
    least_spread: float = setting(
        1e-3, "least standard deviation of the points near the surface, m, at 0.5 m: half the thinnest blade", gt=0, le=100
    )
    most_spread: float = setting(
        0.05, "largest one, likewise; each point's is uniform in its logarithm between both, so that no distance is left out", gt=0, le=100
    )
    reach: float = setting(
        0.27, "half the side of the cube that the other points fill, likewise: objects reach 0.25 m from its middle", gt=0, le=100
    )

    @model_validator(mode="after")
    def _possible(self) -> "DistanceSettings":
        if self.least_spread > self.most_spread:
            raise ValueError(f"least_spread is {self.least_spread}, most_spread {self.most_spread}; the least cannot be above the largest")
        return self
