"""The base of what files, settings and records state."""

from typing import Annotated, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict

T = TypeVar("T")


class Entries(BaseModel):
    """Named values that do not change; an unknown name and a number that is not finite are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def _rising(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"it is {list(limits)}; the least comes first, then the greatest")
    return limits


Range = Annotated[tuple[T, T], AfterValidator(_rising)]
