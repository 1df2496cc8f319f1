"""Description files of hands, sensors and scenes: shipped ones by name, others by the path of a YAML file."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any, Literal, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from pipeline.config.complaints import complaints
from pipeline.errors import InvalidInput

Kind = Literal["hand", "sensor", "scene"]
Model = TypeVar("Model", bound=BaseModel)


def description_path(kind: Kind, name: str | Path) -> Path:
    """Find a description file.

    Parameters
    ----------
    kind
        What the file describes.
    name
        Name of a shipped file, or a path that ends in .yaml or .yml.

    Raises
    ------
    InvalidInput
        There is no such file; the message lists the shipped ones.
    """
    folder = Path(str(resources.files("pipeline"))) / "assets" / f"{kind}s"
    path = Path(name).expanduser() if str(name).endswith((".yaml", ".yml")) else folder / f"{name}.yaml"
    if not path.is_file():
        names = ", ".join(sorted(file.stem for file in folder.glob("*.yaml")))
        raise InvalidInput(f"{kind} {str(name)!r}: there is no file {path}; choose one of [{names}] or give the path of a .yaml file")
    return path


def read_description(kind: Kind, path: Path, model: type[Model]) -> Model:
    """Read and validate a description file.

    Raises
    ------
    InvalidInput
        The file is no YAML, or lacks an entry, or has an unknown or unusable one; the message names the file and every such entry.
    """
    try:
        content: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
        return model.model_validate(content)
    except ValidationError as error:
        raise InvalidInput(f"{kind} file {path}: {complaints(error)}. Its entries are {', '.join(model.model_fields)}") from error
    except yaml.YAMLError as error:
        raise InvalidInput(f"{kind} file {path} is not YAML: {error}") from error
