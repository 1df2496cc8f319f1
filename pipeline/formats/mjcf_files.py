"""Read the files of an MJCF: what it includes, its meshes and textures. MuJoCo itself can open no file."""

import os
import re
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element
from xml.parsers import expat

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import PROLOGUE, parse_xml, read_file, without_mark
from pipeline.formats.mesh_companions import MAX_BYTES
from pipeline.formats.urdf_shapes import REMEDY, is_below, package_around

INSTALL = "reading MJCF needs MuJoCo; `pip install -c constraints.txt -e '.[mujoco]'` installs it (20 MB)"
REFUSED = {"plugin": "delete it, and what uses it", "model": "write both models as one file, with MuJoCo's `MjSpec.to_xml`"}
"""Elements that load code or another model, and the remedy."""


def is_mjcf(path: Path) -> bool:
    """Check whether the first element of a file is that of an MJCF."""
    return re.match(PROLOGUE + rb"<mujoco\b", without_mark(path, read_file(path, MAX_BYTES)), re.DOTALL) is not None


def import_mujoco() -> Any:
    """Import MuJoCo, without its log file; raise an `InvalidInput` with the command that installs it if it is missing."""
    try:
        import mujoco
    except ModuleNotFoundError as error:
        raise InvalidInput(INSTALL) from error
    mujoco.set_mju_user_warning(lambda message: None)  # it would write MUJOCO_LOG.TXT into the working directory
    return mujoco


def read_spec(path: Path) -> tuple[Any, list[Path]]:
    """Read an MJCF as a `MjSpec` of MuJoCo that holds all files it compiles from, every part named; return the files, this one first."""
    mujoco, files = import_mujoco(), _Files(path)
    text, includes = without_mark(path.name, files.read(path.name)), dict[str, bytes]()
    pending = [(path.name, text)]
    for name, content in pending:  # grows
        for element in _parse(content, name).iter("include"):
            included = files.find(element.get("file", ""), os.path.dirname(name))
            if included not in includes:  # MuJoCo refuses the second
                includes[included] = files.read(included)
                pending.append((included, includes[included]))
    spec = without_files("read", lambda: mujoco.MjSpec.from_string(text.decode(), include=includes))
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints), ("tendon", spec.tendons), ("equality", spec.equalities)):
        for number, element in enumerate(elements):
            element.name = element.name or f"{kind}-{number}"
    named = [(spec.meshdir, asset.file) for asset in (*spec.meshes, *spec.hfields, *spec.skins)]
    named += [(spec.texturedir, name) for texture in spec.textures for name in (texture.file, *texture.cubefiles)]
    assets = [os.path.join(folder, os.path.basename(name) if spec.strippath else name) for folder, name in named if name]
    spec.assets = {name: files.read(name) for name in dict.fromkeys(assets)}
    return spec, files.paths


def without_files(verb: str, call: Callable[[], Any]) -> Any:
    """Call MuJoCo while no thread of this process can open a file, whatever it makes of the names in an MJCF."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
    try:
        return call()
    except (ValueError, import_mujoco().FatalError) as error:
        raise InvalidInput(f"MuJoCo cannot {verb} it: {' '.join(str(error).split())}") from error
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def _parse(content: bytes, name: str) -> Element:
    try:
        root = parse_xml(without_mark(name, content))
    except expat.ExpatError as error:
        raise InvalidInput(f"{name} is not XML ({error})") from error
    for tag in (element.tag for element in root.iter() if element.tag in REFUSED):
        raise InvalidInput(f"{name} has <{tag}>, which loads something else: {REFUSED[tag]}")
    return root


class _Files:
    """Files that an MJCF names, relative to its folder. They must lie in its package, or without one in its folder."""

    def __init__(self, path: Path) -> None:
        self._folder = path.parent.resolve()
        self._package = package_around(self._folder) or self._folder
        self._left = MAX_BYTES
        self.paths: list[Path] = []

    def find(self, name: str, folder: str) -> str:
        """Find an included file, as MuJoCo does: from the folder of the MJCF, then from that of the file that includes it."""
        beside = os.path.join(folder, name)
        return beside if (self._folder / beside).is_file() and not (self._folder / name).is_file() else name

    def read(self, name: str) -> bytes:
        path = self._folder / name.replace("\\", "/")
        if not is_below(path, self._package):
            raise InvalidInput(f"it names {name!r}, outside {self._package}, the folder of its files; {REMEDY}")
        content = read_file(path, self._left, f"{name}, which it names,")
        self._left -= len(content)
        self.paths.append(path.resolve())
        return content
