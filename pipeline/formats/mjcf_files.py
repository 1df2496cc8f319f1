"""The files of an MJCF: what it includes, its meshes and textures. All are read here: MuJoCo itself can open none."""

import os
import re
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring
from xml.parsers import expat

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import PROLOGUE, parse_xml, read_file, without_mark
from pipeline.formats.mesh_companions import MAX_BYTES
from pipeline.formats.urdf import MAX_BYTES as MAX_XML
from pipeline.formats.urdf_shapes import REMEDY, is_below, package_around

INSTALL = "reading MJCF needs MuJoCo; `pip install -c constraints.txt -e '.[mujoco]'` installs it (20 MB)"
REFUSED = {
    "plugin": "a plugin, which is code: delete it, and what uses it",
    "model": "another model that it attaches: write both as one file, with `MjSpec.to_xml` of MuJoCo",
}
"""Elements that are refused wherever they are, what they are, and the remedy."""


def is_mjcf(path: Path) -> bool:
    """Check whether the first element of a file is that of an MJCF."""
    return re.match(PROLOGUE + rb"<mujoco(include)?\b", without_mark(path, read_file(path, MAX_XML)), re.DOTALL) is not None


def import_mujoco() -> Any:
    """Import MuJoCo, without its log file; raise an `InvalidInput` with the command that installs it if it is missing."""
    try:
        import mujoco
    except ModuleNotFoundError as error:
        raise InvalidInput(INSTALL) from error
    mujoco.set_mju_user_warning(lambda message: None)  # it would write MUJOCO_LOG.TXT into the working directory
    return mujoco


def kind_of(
    enumeration: str,
    number: Any,  # or an array of one
) -> str:
    """Name a value of an enumeration of MuJoCo's: 3 of `mjtJoint` is "hinge"."""
    name: str = getattr(import_mujoco(), enumeration)(np.asarray(number).item()).name
    return name.partition("_")[2].lower()


def read_spec(path: Path) -> tuple[Any, list[Path]]:
    """Read an MJCF as a `MjSpec` of MuJoCo that holds all files it compiles from, every part named; return the files, this one first."""
    mujoco, files = import_mujoco(), _Files(path)
    text = without_mark(path.name, files.read(path.name))
    whole = files.parse(text, path.name)
    files.include(whole)
    included = len(files.paths) > 1
    try:
        source = (tostring(whole) if included else text).decode()
        with _no_open_files():
            spec = mujoco.MjSpec.from_string(source)
    except RecursionError as error:
        raise InvalidInput("its elements are nested too deep; no hand needs that") from error
    except (ValueError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())  # its line is right unless files were put together
        raise InvalidInput(f"MuJoCo cannot read it: {reason.partition(', line')[0] if included else reason}") from error
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints), ("tendon", spec.tendons), ("equality", spec.equalities)):
        for number, element in enumerate(elements):
            element.name = element.name or f"{kind}-{number}"
    named = [(spec.meshdir, asset.file) for asset in (*spec.meshes, *spec.hfields, *spec.skins)]
    named += [(spec.texturedir, name) for texture in spec.textures for name in (texture.file, *texture.cubefiles)]
    assets = [os.path.join(folder, os.path.basename(name) if spec.strippath else name) for folder, name in named if name]
    spec.assets = {name: files.read(name) for name in dict.fromkeys(assets)}
    return spec, files.paths


def compile_spec(spec: Any) -> Any:
    """Compile what `read_spec` read."""
    mujoco = import_mujoco()
    spec.compiler.usethread = False
    with _no_open_files():
        try:
            return spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise InvalidInput(f"MuJoCo cannot compile it: {' '.join(str(error).split())}") from error


class _Files:
    """The files that an MJCF names, relative to its folder; they must be in its package: without one, in its folder."""

    def __init__(self, path: Path) -> None:
        self._folder = path.parent.resolve()
        self._package = package_around(self._folder) or self._folder
        self._left = MAX_BYTES
        self.paths: list[Path] = []

    def read(self, name: str) -> bytes:
        path = self._path(name)
        if not is_below(path, self._package):
            raise InvalidInput(f"it names {name!r}, outside {self._package}, the folder of its files; {REMEDY}")
        content = read_file(path, self._left, f"{name}, which it names,")
        self._left -= len(content)
        self.paths.append(path.resolve())
        return content

    def _path(self, name: str) -> Path:
        return self._folder / name.replace("\\", "/")

    def parse(self, content: bytes, name: str) -> Element:
        try:
            root = parse_xml(without_mark(name, content))
        except expat.ExpatError as error:
            raise InvalidInput(f"{name} is not XML ({error})") from error
        for element in root.iter():
            if element.tag in REFUSED:
                raise InvalidInput(f"{name} has <{element.tag}>, {REFUSED[element.tag]}")
        return root

    def include(self, whole: Element) -> None:
        """Put the content of files in the place of <include> elements."""
        parents = [(whole, "")]
        for parent, folder in parents:  # grows
            for element in parent:
                inner = folder
                if element.tag == "include":
                    name = element.get("file", "").replace("\\", "/")
                    if not self._path(name).is_file() and self._path(os.path.join(folder, name)).is_file():
                        name = os.path.join(folder, name)  # in MuJoCo the folder of the main file comes first
                    if self._path(name).resolve() in self.paths:
                        raise InvalidInput(f"it includes {name!r} twice, or the file includes itself; MuJoCo includes a file once")
                    element.extend(self.parse(self.read(name), name))
                    inner = os.path.dirname(name)
                parents.append((element, inner))
        for parent, _ in reversed(parents):  # innermost first
            parent[:] = [part for element in parent for part in (element if element.tag == "include" else [element])]


@contextmanager
def _no_open_files() -> Iterator[None]:
    """Let no thread of this process open a file, whatever MuJoCo makes of the names in an MJCF."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
