"""Every artifact by name, in the order in which they are made: those that the modules of this package declare."""

from importlib import import_module
from pkgutil import iter_modules

import schemas
from schemas.base import Artifact

_modules = [import_module(f"schemas.{module.name}") for module in iter_modules(schemas.__path__) if module.name != "catalogue"]
_declared = [value for module in _modules for value in vars(module).values() if isinstance(value, Artifact)]
ARTIFACTS = {artifact.name: artifact for artifact in sorted(_declared, key=lambda artifact: (artifact.order, artifact.name))}


def artifact_of(array: str) -> Artifact:
    """Find the first artifact that has an array of this name; a `KeyError` that lists all names where there is none."""
    for artifact in ARTIFACTS.values():
        if array in artifact.arrays:
            return artifact
    known = sorted({name for artifact in ARTIFACTS.values() for name in artifact.arrays})
    raise KeyError(f"no artifact has an array {array}; there are {', '.join(known)}")
