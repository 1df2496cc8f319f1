"""Every artifact by name, in the order in which they are made: first those of this package's modules, then those of plugins."""

from collections import UserDict
from importlib import import_module
from importlib.metadata import EntryPoint
from pkgutil import iter_modules

import schemas
from pipeline import plugins
from pipeline.errors import StoreError, closest_name
from schemas.base import Artifact


class _Catalogue(UserDict[str, Artifact]):
    """Artifacts by name; one that a plugin declares is imported when it is first used."""

    data: dict[str, Artifact | EntryPoint]  # type: ignore[assignment]

    def __getitem__(self, name: str) -> Artifact:
        entry = self.data[name]
        if isinstance(entry, EntryPoint):
            artifact = plugins.load(entry, StoreError)
            if not isinstance(artifact, Artifact) or artifact.name != name:
                raise StoreError(f"{entry.value} of package {plugins.package_of(entry)} is not an Artifact called {name}")
            self.data[name] = entry = artifact
        return entry


_modules = [import_module(f"schemas.{module.name}") for module in iter_modules(schemas.__path__) if module.name != "catalogue"]
_declared = [value for module in _modules for value in vars(module).values() if isinstance(value, Artifact)]
_own = {artifact.name: artifact for artifact in sorted(_declared, key=lambda artifact: (artifact.order, artifact.name))}
ARTIFACTS = _Catalogue(_own)
for _entry in plugins.declared("schemas"):
    ARTIFACTS.data.setdefault(_entry.name, _entry)


def artifact_of(array: str) -> Artifact:
    """Find the first artifact that has an array of this name or path; raise a `KeyError` that lists all names if there is none."""
    for artifact in ARTIFACTS.values():
        if artifact.of(array):
            return artifact
    names = sorted({name for artifact in ARTIFACTS.values() for name in (*artifact.arrays, *artifact.ragged)})
    guess = closest_name(array, names)
    raise KeyError(f"no artifact has an array {array}{f', did you mean {guess}?' if guess else ';'} there are {', '.join(names)}")
