"""The base of what files, settings and records state."""

from pydantic import BaseModel, ConfigDict


class Entries(BaseModel):
    """Named values that do not change; an unknown name and a number that is not finite are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
