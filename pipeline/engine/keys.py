"""Keys: one hash of the inputs, settings, code and seed that an output depends on."""

import ast
import hashlib
import json
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from importlib import util
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.config.sources import fingerprint, modelled
from pipeline.store import digest
from pipeline.store.atomic import write_atomically
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

    `RANDOM_STREAMS` is hashed too. Nothing is imported for it.
    """
    packages = frozenset({*OURS, module.partition(".")[0]})
    if (origin := _file_of(module, packages)) is None:
        raise ModuleNotFoundError(f"there is no module {module} to hash")
    parsed, sources = _ParsedFiles(), {module: origin}
    waiting = [RANDOM_STREAMS, *parsed.file(module, origin).imports]
    while waiting:
        name = waiting.pop()
        path = _file_of(name, packages)
        if name in sources or path is None or any(name == layer or name.startswith(f"{layer}.") for layer in NO_RESULTS):
            continue
        sources[name] = path
        waiting += parsed.file(name, path).imports
    for package in list(sources):
        while package := package.rpartition(".")[0]:  # it runs too; what it imports decides for others
            if package not in sources and (path := _file_of(package, packages)):
                sources[package] = path
    hashes = sorted((name, parsed.file(name, path).sha256) for name, path in sources.items())
    parsed.save()
    return digest.of_json(hashes)


class _Parsed(NamedTuple):
    """A source file: its hash, and the modules of ours or its own package that it may import."""

    stamp: list[int]
    sha256: str
    imports: list[str]


class _ParsedFiles:
    """Parsed source files, kept beside the compiled ones: parsing takes a second. A file that was written since is parsed again."""

    def __init__(self) -> None:
        self._path, self._maker, self._changed = (
            Path(util.cache_from_source(__file__)).with_name("sources.json"),
            _stamp(Path(__file__)),
            False,
        )
        try:
            kept = json.loads(self._path.read_bytes())
            self._files = {name: _Parsed(*file) for name, file in kept["files"].items()} if kept["maker"] == self._maker else {}
        except (OSError, ValueError, KeyError, TypeError):
            self._files = {}

    def file(self, module: str, path: Path) -> _Parsed:
        """Parse a module's file, unless it is known."""
        package = module if path.stem == "__init__" else module.rpartition(".")[0]
        name, stamp = f"{package} {path}", _stamp(path)
        if name not in self._files or self._files[name].stamp != stamp:
            self._files[name], self._changed = _Parsed(stamp, *_parse(package, path)), True
        return self._files[name]

    def save(self) -> None:
        """Keep what was parsed, if the folder can be written to."""
        if self._changed:
            with suppress(OSError):
                write_atomically(self._path, json.dumps({"maker": self._maker, "files": self._files}).encode(), durable=False)


def _stamp(path: Path) -> list[int]:
    """Return what changes whenever a file is written or replaced."""
    status = path.stat()
    return [status.st_mtime_ns, status.st_ctime_ns, status.st_ino, status.st_size]


def _parse(package: str, path: Path) -> tuple[str, list[str]]:
    """Hash a file as its syntax tree, in which comments and layout do not count, and list its imports."""
    if path.suffix != ".py":  # compiled
        return hashlib.sha256(path.read_bytes()).hexdigest(), []
    tree, tops = ast.parse(path.read_bytes()), {*OURS, package.partition(".")[0]}
    imports = dict.fromkeys(name for name in _imports(tree, package) if name.partition(".")[0] in tops)
    return hashlib.sha256(syntax(tree).encode()).hexdigest(), list(imports)


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
