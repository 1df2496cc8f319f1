"""Keys: one hash of the inputs, settings, code and seed that an output depends on."""

import ast
import hashlib
from collections.abc import Iterable
from functools import cache
from importlib import util
from pathlib import Path
from typing import Any

from pipeline.config.sources import fingerprint, modelled
from pipeline.formats.file_cache import FileCache, stamps_of
from pipeline.store import digest
from pipeline.store.storage import read_bytes

OURS = ("pipeline", "stages", "schemas")

NO_RESULTS = ("pipeline.cli", "pipeline.console", "pipeline.engine", "pipeline.errors", "pipeline.plugins", "pipeline.store")
"""Layers that no result depends on. Every other layer counts, also a new one."""

PARSED = Path(util.cache_from_source(__file__)).with_name("sources.pickle")  # where parsed source files are kept, beside compiled ones
WRITTEN_BY = stamps_of([Path(__file__)])

RANDOM_STREAMS = "pipeline.rng"
"""A module that every key depends on: a stage need not import it, because units bring their random generators (`Unit.rng`)."""


def code_hash(stage: object) -> str:
    """Hash a stage's code: its folder, and whatever it imports of its own package and of the layers that results depend on."""
    return sources_hash(type(stage).__module__)


@cache
def sources_hash(module: str) -> str:
    """Hash a module, ours or a plugin's, with its direct and indirect imports of ours and of its own package.

    `RANDOM_STREAMS` is hashed too. Nothing is imported for it.
    """
    packages = frozenset({*OURS, module.partition(".")[0]})
    if _file_of(module, packages) is None:
        raise ModuleNotFoundError(f"there is no module {module} to hash")
    parsed_files = FileCache(PARSED, WRITTEN_BY, limit=10_000)

    def parse(name: str, path: Path) -> tuple[str, list[str]]:
        package = name if path.stem == "__init__" else name.rpartition(".")[0]
        parsed: tuple[str, list[str]] | None = parsed_files.find(f"{package} {path}")
        if parsed is None:
            parsed = _parse(package, path)
            parsed_files.keep(f"{package} {path}", parsed, [path])
        return parsed

    hashes: dict[str, str] = {}
    waiting = [module, RANDOM_STREAMS]
    while waiting:
        name = waiting.pop()
        path = _file_of(name, packages)
        no_result = name != module and any(name == layer or name.startswith(f"{layer}.") for layer in NO_RESULTS)
        if path and name not in hashes and not no_result:
            hashes[name], imports = parse(name, path)
            waiting += imports
    for package in list(hashes):
        while package := package.rpartition(".")[0]:  # it runs too; what it imports decides for others
            if package not in hashes and (path := _file_of(package, packages)):
                hashes[package], _ = parse(package, path)
    parsed_files.save()
    return digest.of_json(sorted(hashes.items()))


def _parse(package: str, path: Path) -> tuple[str, list[str]]:
    """Hash a file as its syntax tree, in which comments and layout do not count, and list its imports."""
    if path.suffix != ".py":  # compiled
        return hashlib.sha256(path.read_bytes()).hexdigest(), []
    tree, tops = ast.parse(path.read_bytes()), {*OURS, package.partition(".")[0]}
    names: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            module = util.resolve_name("." * node.level + (node.module or ""), package)
            names += [module, *(f"{module}.{alias.name}" for alias in node.names)]
    imports = dict.fromkeys(name for name in names if name.partition(".")[0] in tops)
    return hashlib.sha256(syntax(tree).encode()).hexdigest(), list(imports)


def syntax(node: object) -> str:
    """Write a syntax tree the same way on every version of Python: `ast.dump` names empty fields that other versions lack."""
    if isinstance(node, ast.AST):
        fields = (f" {name}={syntax(value)}" for name, value in ast.iter_fields(node) if value is not None and value != [])
        return f"({type(node).__name__}{''.join(fields)})"
    return f"[{' '.join(map(syntax, node))}]" if isinstance(node, list) else repr(node)


@cache
def _file_of(module: str, packages: frozenset[str]) -> Path | None:
    """Find the source of a module of these packages; None for other packages, and for names that are not modules."""
    top, *inner = module.split(".")
    spec = util.find_spec(top) if top in packages else None
    if spec is None or spec.submodule_search_locations is None:
        return Path(spec.origin) if spec and spec.origin and not inner else None
    for location in spec.submodule_search_locations:
        path = Path(location, *inner)
        compiled: list[Path] = [] if top in OURS else [*path.parent.glob(f"{path.name}.*.so")]
        for file in (path / "__init__.py", path.with_name(f"{path.name}.py"), *compiled):
            if file.is_file():
                return file
    return None


def assets_digest(paths: Iterable[Path]) -> str:
    """Hash data files that a stage reads, in the order in which it names them; their paths do not count."""
    return digest.of_json([hashlib.sha256(read_bytes(path)).hexdigest() for path in paths])


def source_key(source: dict[str, Any]) -> dict[str, Any]:
    """Describe an object's source for its key: by the content of its files, or the code that models it."""
    code = {"code": sources_hash(modelled(source).module(source))} if "kind" in source else {}
    return {**fingerprint(source), **code}
