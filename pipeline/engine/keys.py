"""Keys: one hash of the inputs, settings, code and seed that an output depends on."""

import ast
import hashlib
from collections.abc import Iterable, Sequence
from functools import cache
from importlib import util
from pathlib import Path
from typing import Any

from pipeline.config.objects import fingerprint
from pipeline.config.sources import modelled
from pipeline.store import digest
from pipeline.store.rows import Row
from pipeline.store.storage import read_bytes

OURS = ("pipeline", "stages", "schemas")

NO_RESULTS = ("pipeline.cli", "pipeline.console", "pipeline.engine", "pipeline.errors", "pipeline.plugins", "pipeline.store")
"""Layers that no result depends on. Every other layer counts, also a new one."""

RANDOM_STREAMS = "pipeline.rng"
"""A module that every key depends on: a stage need not import it, because units bring their random generators (`Unit.rng`)."""


def code_hash(stage: object) -> str:
    """Hash a stage's code: its folder, and whatever it imports of its own package and of the layers that results depend on."""
    return sources_hash(type(stage).__module__)


@cache
def sources_hash(module: str) -> str:
    """Hash a module, ours or a plugin's, with its direct and indirect imports of ours and of its own package.

    `RANDOM_STREAMS` is hashed too.
    """
    spec = util.find_spec(module)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(f"there is no module {module} to hash")
    packages = frozenset({*OURS, module.partition(".")[0]})
    sources = {module: Path(spec.origin)}
    waiting = [RANDOM_STREAMS, *_source(module, sources[module])[1]]
    while waiting:
        name = waiting.pop()
        path = _file_of(name, packages)
        if name in sources or path is None or any(name == layer or name.startswith(f"{layer}.") for layer in NO_RESULTS):
            continue
        sources[name] = path
        waiting += _source(name, path)[1]
    for package in list(sources):
        while package := package.rpartition(".")[0]:  # it runs too; what it imports decides for others
            if package not in sources and (path := _file_of(package, packages)):
                sources[package] = path
    return digest.of_json(sorted((name, _source(name, path)[0]) for name, path in sources.items()))


def _source(module: str, path: Path) -> tuple[str, tuple[str, ...]]:
    """Return the hash of a module's source file, and the modules that it may import."""
    package = module if path.stem == "__init__" else module.rpartition(".")[0]
    return _parsed(package, path, path.stat().st_mtime_ns)


@cache
def _parsed(package: str, path: Path, changed: int) -> tuple[str, tuple[str, ...]]:
    """Hash a file as its syntax tree, in which comments and layout do not count; most stages share most files."""
    if path.suffix != ".py":  # compiled
        return hashlib.sha256(path.read_bytes()).hexdigest(), ()
    tree = ast.parse(path.read_bytes())
    return hashlib.sha256(syntax(tree).encode()).hexdigest(), tuple(_imports(tree, package))


def syntax(node: object) -> str:
    """Write a syntax tree the same way on every version of Python: `ast.dump` names empty fields that other versions lack."""
    if isinstance(node, ast.AST):
        fields = (f" {name}={syntax(value)}" for name, value in ast.iter_fields(node) if value is not None and value != [])
        return f"({type(node).__name__}{''.join(fields)})"
    return f"[{' '.join(map(syntax, node))}]" if isinstance(node, list) else repr(node)


def _imports(tree: ast.Module, package: str) -> Iterable[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            module = util.resolve_name("." * node.level + (node.module or ""), package)
            yield module
            for alias in node.names:
                yield f"{module}.{alias.name}"


@cache
def _file_of(module: str, packages: frozenset[str]) -> Path | None:
    """Find the source of a module of these packages; None for other packages, and for names that are not modules."""
    if module.partition(".")[0] not in packages:
        return None
    try:
        spec = util.find_spec(module)
    except ModuleNotFoundError:  # the name of something in a module
        return None
    return Path(spec.origin) if spec and spec.origin else None


def assets_digest(paths: Iterable[Path]) -> str:
    """Hash data files that a stage reads, in the order in which it names them; their paths do not count."""
    return digest.of_json([hashlib.sha256(read_bytes(path)).hexdigest() for path in paths])


def source_key(source: dict[str, Any]) -> dict[str, Any]:
    """Describe an object's source for its key: by the content of its files, or the code that models it."""
    code = {} if "file" in source else {"code": sources_hash(modelled(source).module(source))}
    return {**fingerprint(source), **code}


def object_key(stage_key: str, object_id: str, category: str, inputs: Any) -> str:
    """Compute the key of one object's row: from its stage's key, the object, and its inputs (a source's key, or rows' digests)."""
    return digest.of_json({"stage": stage_key, "object": object_id, "category": category, "inputs": inputs})


def shard_key(
    rows: Iterable[tuple[str, str]],  # key and split of each
    number: int,
    shards: int,
    manifest: str,
    missing: Sequence[str],  # objects that the shard lacks
    labels: Row | None,  # of dimensions, from its inputs
) -> str:
    """Compute the key of a shard from its rows and what else its group holds."""
    lacks = {"missing": list(missing)} if missing else {}
    labelled = {"labels": digest.of_arrays(labels)} if labels else {}
    return digest.of_json({"rows": list(rows), "shard": [number, shards], "manifest": manifest, **lacks, **labelled})
