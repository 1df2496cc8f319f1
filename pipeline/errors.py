"""Errors that a user can fix; the message names the thing, its value, the limit and the remedy.

Any other error is a fault of the project and keeps its traceback.
"""

from collections.abc import Collection
from difflib import get_close_matches


class PipelineError(Exception):
    """The base of all errors below: a command ends with the message instead of a traceback."""


class InvalidInput(PipelineError, ValueError):
    """An input cannot be used: a mesh, an image, a pose, a manifest, a description file, a setting, an option.

    While an object is processed, it is that object's failure.
    """


class StageError(PipelineError):
    """A stage cannot work here at all: a library or device is missing, or there is nothing to train on."""


class StoreError(PipelineError):
    """A stored artifact is missing, incomplete, damaged, or differs from its schema."""


class OtherVersion(StoreError):
    """A stored artifact is of another version of this project, and not damaged."""


class BugFound(PipelineError):
    """A stage raised an unexpected error: a fault of the project, reported with its traceback."""


def closest_name(name: object, names: Collection[str]) -> str | None:
    """Find the name that is most similar to a misspelt one; None if none is similar."""
    return next(iter(get_close_matches(str(name), names, n=1, cutoff=0.7)), None)


def unknown_name(kind: str, name: object, names: Collection[str]) -> str:
    """Describe an unknown name of some kind, such as a stage: suggest the closest name, and list all of them."""
    guess = closest_name(name, names)
    return f"unknown {kind} {name}{f', did you mean {guess}?' if guess else ';'} choose from {', '.join(names)}"


def missing_name(kind: str, name: str, names: Collection[str]) -> str:
    """Describe a name that a file lacks, such as a link's: list those that it has."""
    return f"there is no {kind} {name!r}; there are {', '.join(sorted(names)) or 'none at all'}"


def first_line(error: Exception) -> str:
    """Return the first line of an error's message, or its type if the message is empty."""
    return next(iter(str(error).splitlines()), type(error).__name__)
