"""Keys: what an output is a function of, as one hash of inputs, settings, code and seed."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable
from functools import cache
from importlib import util
from pathlib import Path
from typing import Any

from pipeline.engine.stage import Stage
from pipeline.store import digest

DECIDES_RESULTS = (
    *(
        "stages",
        "schemas",
        "pipeline.config",
        "pipeline.dataset",
        "pipeline.kernels",
        "pipeline.models",
        "pipeline.reports",
        "pipeline.rng",
    ),
    *("pipeline.engine.stage", "pipeline.toy_objects", "pipeline.training"),
)
"""What decides results, and pictures of them; processes, files and progress around it do not."""


def code_hash(stage: Stage) -> str:
    """The hash of a stage's sources: its own module and, wherever it leads, what that imports of ours that decides results."""
    return sources_hash(type(stage).__module__)


@cache
def sources_hash(module: str) -> str:
    """The hash of a module and of what it stands on."""
    sources = sorted((name, _normal_form(path)) for name, path in sources_of(module).items())
    return digest.of_json(sources)


def sources_of(module: str) -> dict[str, Path]:
    """The modules that `module` stands on, itself included, with their files: found by reading imports, running nothing."""
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = _file_of(name)
        if name in found or path is None:
            continue
        found[name] = path
        waiting += _imports(path)
        waiting.append(name.rpartition(".")[0])  # a package's __init__ runs before its modules
    return found


def _normal_form(path: Path) -> str:
    """A source file as its syntax tree: comments and layout decide nothing."""
    return hashlib.sha256(ast.dump(ast.parse(path.read_text())).encode()).hexdigest()


def _imports(path: Path) -> Iterable[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def _file_of(module: str) -> Path | None:
    """The source of a module that counts; None for every other, and for names that are no modules."""
    if not any(module == package or module.startswith(f"{package}.") for package in DECIDES_RESULTS):
        return None
    try:
        spec = util.find_spec(module)
    except ModuleNotFoundError:  # the name of something in a module
        return None
    return Path(spec.origin) if spec and spec.origin else None


def asset_hashes(paths: Iterable[Path]) -> list[str]:
    """The hash of every data file a stage reads, in the order in which it names them: where they lie decides nothing."""
    return [hashlib.sha256(path.read_bytes()).hexdigest() for path in paths]


def object_key(stage_part: str, object_id: str, category: str, inputs: Any) -> str:
    """The key of one object's row: the stage's part, the object, and its inputs (a source's fingerprint, or rows' digests)."""
    return digest.of_json({"stage": stage_part, "object": object_id, "category": category, "inputs": inputs})
