"""A scene: camera, lamp, constant light and background, as a file in `pipeline/assets/scenes` describes them."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.kernels.vision.camera import Camera, Vector

Share = Annotated[float, Field(ge=0, le=1)]
Light = Annotated[float, Field(ge=0)]


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Lamp(_Model):
    """A point light whose light falls off with the square of the distance.

    `position` in the world, m; a white surface that faces it at d metres shows `intensity` / d² (linear, 1 is white); `color`
    linear RGB. It casts no shadow. What it would light brighter than white is white; the point of a surface that it stands on
    it does not light.
    """

    position: Vector
    intensity: float = Field(gt=0)
    color: tuple[Share, Share, Share]


class Scene(_Model):
    """What surrounds the object: a camera, one lamp, constant light (linear RGB), and the background's colour (sRGB, 0..1)."""

    name: str
    summary: str
    camera: Camera
    lamp: Lamp
    ambient: tuple[Light, Light, Light]
    background: tuple[Share, Share, Share]


def scene_path(name: str) -> Path:
    """The file of a scene: one of those that come with the project, by name, or any YAML file, by path.

    Raises
    ------
    FileNotFoundError
        Where there is no such scene; the message lists those there are.
    """
    if name.endswith((".yaml", ".yml")):
        if not Path(name).is_file():
            raise FileNotFoundError(f"scene file {name!r} does not exist")
        return Path(name)
    folder = Path(str(resources.files("pipeline") / "assets" / "scenes"))
    path = folder / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in folder.glob("*.yaml")))
        raise FileNotFoundError(f"there is no scene called {name!r}: choose one of {known}, or give a path that ends in .yaml")
    return path


def load_scene(name: str) -> Scene:
    """The scene of that name or path (see `scene_path`), validated: an unknown key is an error.

    Raises
    ------
    ValueError
        Where the file is no valid scene; the message names the file and every offending key.
    """
    path = scene_path(name)
    try:
        return Scene.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
    except (ValidationError, yaml.YAMLError) as error:
        raise ValueError(f"scene file {path}: {error}") from error
