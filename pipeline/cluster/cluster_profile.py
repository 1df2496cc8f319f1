"""Cluster files: YAML descriptions of the resources of one task on a Slurm cluster."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from pipeline.formats.description_file import description_path, read_description


def _require_text(value: Any) -> Any:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        raise ValueError(f"YAML reads it as the number {value}; write it in quotes and with its unit, as '04:00:00' or '16G'")
    return value


def _require_one_line(line: str) -> str:
    if not line.isprintable():
        raise ValueError(
            f"{line!r} is not a single line of printable text, as a job's script needs; remove control characters and line breaks"
        )
    return line


Line = Annotated[str, AfterValidator(_require_one_line)]
Word = Annotated[Line, Field(pattern=r"^[^\s,]+$")]
Number = Annotated[int, Field(ge=1, le=10**6)]


class Allocation(BaseModel):
    """The resources of one task: a partition, cores, memory and time, as `sbatch` takes them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    partition: Word
    cores: Number
    memory: Annotated[str, BeforeValidator(_require_text), Field(pattern=r"^[1-9][0-9]*[KMGT]$")]
    time: Annotated[str, BeforeValidator(_require_text), Field(pattern=r"^([0-9]+-)?[0-9]+(:[0-9]{2}){0,2}$")]


class GpuAllocation(Allocation):
    """An allocation with GPUs: how many, or their type and how many."""

    gpus: Number | Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+:[1-9][0-9]*$")] = 1


class ClusterProfile(BaseModel):
    """Describe a Slurm cluster."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Line
    summary: str = ""
    cpu: Allocation  # the resources of a task
    gpu: GpuAllocation | None = None  # those of stages that use a GPU, if the cluster has any
    # maximum number of tasks of one array that run at a time; None leaves it to the cluster
    concurrent: Number | None = None
    setup: tuple[Line, ...] = ()  # shell lines that every task runs first
    # how the nodes call vt-pipeline; None is the Python that submits, on a file system that the nodes share
    command: Line | None = None
    account: Word | None = None  # the account that is charged
    options: tuple[Annotated[Line, Field(pattern=r"^--[a-z][a-z-]*(=\S+)?$")], ...] = ()  # more options of `sbatch`


def load_cluster(name: str | Path) -> ClusterProfile:
    """Read a cluster by the name of a shipped file or by path; raise an `InvalidInput` that names the file and the fault."""
    return read_description("cluster", description_path("cluster", name), ClusterProfile)
