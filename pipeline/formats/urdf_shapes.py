"""The shapes of a URDF's links: primitives and mesh files, with their colours."""

from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.file_units import stated_units
from pipeline.formats.mesh_parts import GREY
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.geometry.transforms import rotation_from_euler, transform_points
from pipeline.kernels.hand.model import Shape

Color = tuple[int, int, int]
MAX_NUMBER = 1e6  # maximum of a number, metres or radians
MAX_TURN, MAX_SLIDE = 1.01 * 2 * np.pi, 1.0  # rad, m; larger ones of a joint are in degrees or millimetres
MAX_LEVELS = 20  # number of folders around a URDF in which a package is searched for
REMEDY = "copy it there, or put an empty package.xml into the folder that holds both"
MeshReader = Callable[[Path, Path], tuple[Mesh, tuple[Path, ...]]]
"""Reads a mesh file, whose companions are below a folder, its package: the mesh, and the companions."""

PRIMITIVES: Mapping[str, tuple[dict[str, int], Callable[..., Any]]] = {
    "box": ({"size": 3}, lambda creation, *size: creation.box(extents=size)),
    "sphere": ({"radius": 1}, lambda creation, radius: creation.icosphere(subdivisions=3, radius=radius)),
    "cylinder": ({"radius": 1, "length": 1}, lambda creation, radius, length: creation.cylinder(radius, height=length, sections=32)),
    "capsule": ({"radius": 1, "length": 1}, lambda creation, radius, length: creation.capsule(length, radius, count=(16, 32))),
}
"""The count of numbers of each attribute of a shape, and the shape of these sizes by `trimesh.creation`, which takes half a second."""


def shape_of(
    element: Element,
    folder: Path,  # of the URDF, to which the paths of mesh files are relative
    materials: Mapping[str, Color],  # by the names of the URDF's materials
    read: MeshReader,
) -> Shape:
    """Read a <visual> or <collision>."""
    material = element.find("material")
    (origin, rpy), color = origin_of(element), material_color(material, materials)
    for part in element.findall("geometry/*"):
        body: Any
        companions: tuple[Path, ...] = ()
        path, scale = None, (1.0, 1.0, 1.0)
        if part.tag in PRIMITIVES:
            from trimesh import creation

            counts, create = PRIMITIVES[part.tag]
            size = _sizes(part, **counts)
            body = create(creation, *size)
        elif part.tag == "mesh":
            path, package = mesh_path(part.get("filename", ""), folder)
            body, companions = read(path, package)
            unit, _ = stated_units(path)  # COLLADA's counts, as in ROS; its up-axis does not
            size = scale = tuple((numbers_of(part, "scale", scale) * (unit or 1)).tolist())
        else:
            continue
        vertices, faces = transform_points(origin, body.vertices * scale), np.asarray(body.faces, np.int32)
        plain = Look.plain(len(vertices), len(faces), color)
        look = body.look if part.tag == "mesh" and material is None else plain  # a mesh without a material keeps its own
        return Shape(part.tag, size, origin, Mesh(vertices, faces, look), path, companions, rpy)
    given = ", ".join(f"<{part.tag}>" for part in element.findall("geometry/*")) or "no geometry"
    raise InvalidInput(f"a {element.tag} has {given}; give it a box, sphere, cylinder, capsule or mesh")


def mesh_path(name: str, folder: Path) -> tuple[Path, Path]:
    """Find a mesh file by the name that a URDF gives it, in the URDF's package, and the folder of its package.

    That is the nearest folder around the URDF that has a `package.xml`; where none has, the one above the URDF's folder.
    `package://PACKAGE/REST` is searched for in the folders around the URDF: as `PACKAGE/REST`, in another package too if it has a
    `package.xml`; then as `REST`. Other names are relative to the URDF's folder, or absolute.
    """
    folder = folder.resolve()
    ancestors = list(islice((folder, *folder.parents), MAX_LEVELS))
    root = package_around(folder) or folder.parent
    scheme, _, rest = name.rpartition("://")
    if scheme not in ("package", "model"):
        path = folder / name.removeprefix("file://")
        if is_below(path, root):
            return path, root
        raise InvalidInput(f"{name!r} lies outside {root}, the package of the URDF; {REMEDY}")
    package, _, inner = rest.partition("/")
    candidates = [(folder / rest, folder / package if _is_package(folder / package) else root) for folder in ancestors]
    candidates += [(folder / inner, root) for folder in ancestors if inner]
    existing = [(path, limit) for path, limit in candidates if path.is_file()]
    for path, limit in existing:
        if is_below(path, limit):
            return path, limit
    if existing:
        raise InvalidInput(f"{name} is {existing[0][0]}, outside {root}, the package of the URDF; {REMEDY}")
    raise InvalidInput(f"{name} is in no folder around {folder}; put package {package!r} beside the URDF, or write paths relative to it")


def package_around(folder: Path) -> Path | None:
    """Find the nearest folder around a resolved one, or itself, that has a `package.xml`."""
    return next((ancestor for ancestor in islice((folder, *folder.parents), MAX_LEVELS) if _is_package(ancestor)), None)


def _is_package(folder: Path) -> bool:
    return (folder / "package.xml").is_file()


def is_below(path: Path, root: Path) -> bool:
    """Check whether a path, as its links lead, is in a folder."""
    try:
        return path.resolve().is_relative_to(root.resolve())
    except (OSError, ValueError, RuntimeError) as error:  # too long, a zero byte, a link to itself
        raise InvalidInput(f"{str(path)!r} is not the path of a file ({error}); give that of a mesh file") from error


def material_color(material: Element | None, materials: Mapping[str, Color]) -> Color:
    """Read the sRGB colour of a material, by its own element or by name."""
    if material is None:
        return GREY[:3]
    color = material.find("color")
    if color is None:
        return materials.get(material.get("name", ""), GREY[:3])
    red, green, blue, _ = (round(255 * part) for part in np.clip(numbers_of(color, "rgba", (0.7, 0.7, 0.7, 1.0)), 0, 1).tolist())
    return red, green, blue


def numbers_of(element: Element | None, key: str, default: tuple[float, ...]) -> Array:
    """Read the finite numbers of an attribute, as many as the default, which a missing one has; blanks or commas separate them."""
    if element is None or (text := element.get(key)) is None:
        return np.array(default, np.float64)
    try:
        numbers = np.array([float(part) for part in text.replace(",", " ").split()], np.float64)
    except ValueError:
        numbers = np.array([np.nan])
    if len(numbers) != len(default) or not (np.abs(numbers) <= MAX_NUMBER).all():
        raise InvalidInput(f"<{element.tag} {key}={text!r}> must hold {len(default)} finite numbers, none beyond {MAX_NUMBER:g}")
    return numbers


def check_unit(what: str, numbers: Sequence[float] | Array, *, slides: bool = False) -> None:
    """Refuse angles, rad, that are evidently in degrees, and paths of joints that slide, m, evidently in millimetres."""
    limit, unit, other, factor = (MAX_SLIDE, "m", "millimetres", 1e-3) if slides else (MAX_TURN, "rad", "degrees", np.pi / 180)
    if (np.abs(numbers) > limit).any():
        between = " … " if len(numbers) == 2 else " "
        stated, converted = (between.join(f"{scale * number:.4g}" for number in numbers) for scale in (1.0, factor))
        raise InvalidInput(f"{what} {stated} {unit}, beyond {limit:.3g}; are they in {other}? Then write {converted}")


def origin_of(element: Element) -> tuple[Array, tuple[float, ...]]:
    """Read the <origin> of an element: the pose (4, 4), m, and its roll, pitch and yaw, rad, about fixed axes."""
    origin = element.find("origin")
    pose = np.eye(4)
    if origin is not None and origin.get("quat_xyzw"):  # of URDF 1.1; the physics engines ignore it
        raise InvalidInput(f"<origin quat_xyzw={origin.get('quat_xyzw')!r}> is not read; write the same rotation as rpy")
    angles = numbers_of(origin, "rpy", (0.0, 0.0, 0.0))
    check_unit("<origin> has rpy", angles)
    pose[:3, :3] = rotation_from_euler(angles)
    pose[:3, 3] = numbers_of(origin, "xyz", (0.0, 0.0, 0.0))
    return pose, tuple(angles.tolist())


def _sizes(element: Element, **counts: int) -> tuple[float, ...]:
    sizes: list[float] = []
    for key, count in counts.items():
        numbers = numbers_of(element, key, (0.0,) * count)
        if not (numbers > 0).all():
            raise InvalidInput(f"a {element.tag} has {key}={element.get(key)!r}; give positive metres")
        sizes += numbers.tolist()
    return tuple(sizes)
