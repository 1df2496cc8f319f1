"""Unpack furniture libraries of Sweet Home 3D into a folder that a manifest with a `catalogue` source takes.

Run as `python -m tools.furniture_library FOLDER LIBRARY.sh3f...`.
"""

import csv
import re
import sys
import zipfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import MESH_SUFFIXES

LIST = "PluginFurnitureCatalog.properties"
COLUMNS = ("object_id", "category", "file", "up", "name", "licence", "creator")


def unpack(libraries: Sequence[Path], folder: Path) -> tuple[int, list[str]]:  # models, a line for each that was skipped
    """Unpack the models of libraries, with what their folders hold, and write `catalogue.csv` last.

    A `.sh3f` file is a zip archive of one folder per model, and of a list with each model's name, category, licence and creator.
    """
    folder.mkdir(parents=True, exist_ok=True)
    models: list[dict[str, str]] = []
    skipped: list[str] = []
    for library in libraries:
        try:
            with zipfile.ZipFile(library) as archive:
                for model in _models(archive):
                    file = PurePosixPath(model["file"])
                    if file.suffix.lower() not in MESH_SUFFIXES:
                        skipped.append(
                            f"{model['name']} ({file}): {file.suffix} cannot be read; convert it to one of {', '.join(MESH_SUFFIXES)}"
                        )
                        continue
                    archive.extractall(folder, [name for name in archive.namelist() if PurePosixPath(name).is_relative_to(file.parent)])
                    models.append(model)
        except (OSError, KeyError, zipfile.BadZipFile) as error:
            raise InvalidInput(f"{library} is not a furniture library ({error}); give .sh3f files of Sweet Home 3D") from error
    with (folder / "catalogue.csv").open("w", newline="", encoding="utf-8") as file_opened:
        writer = csv.DictWriter(file_opened, COLUMNS)
        writer.writeheader()
        writer.writerows(models)
    return len(models), skipped


def _models(archive: zipfile.ZipFile) -> Iterator[dict[str, str]]:
    """Describe each model of a library as a line of the catalogue."""
    library: dict[str, str] = {}
    models: defaultdict[int, dict[str, str]] = defaultdict(dict)
    for line in archive.read(LIST).decode("latin-1").splitlines():
        if entry := re.fullmatch(r"(\w+)(?:#(\d+))?\s*=\s*(.*)", line):
            key, number, value = entry.groups()
            (library if number is None else models[int(number)])[key] = _unescaped(value)
    for _, model in sorted(models.items()):
        file = PurePosixPath(model["model"].lstrip("/"))
        yield {
            "object_id": "-".join(file.parent.parts),
            "category": model["category"],
            "file": str(file),
            "up": _up(model.get("modelRotation", "1 0 0 0 1 0 0 0 1")),
            "name": model["name"],
            "licence": library.get("license", ""),  # as the creators, not in every library
            "creator": model.get("creator", ""),
        }


def _up(rotation: str) -> str:
    """Name the axis of the file that a rotation, nine numbers row by row, turns upright, which is y here."""
    sizes = [abs(float(number)) for number in rotation.split()[3:6]]
    return "xyz"[sizes.index(max(sizes))]


def _unescaped(value: str) -> str:
    """Replace the escapes of a Java properties file."""
    value = re.sub(r"\\u([0-9a-fA-F]{4})", lambda code: chr(int(code[1], 16)), value)
    return re.sub(r"\\(.)", r"\1", value).strip()


def main() -> None:
    """Unpack the libraries that the command line names, and print what was skipped."""
    if len(sys.argv) < 3:
        raise SystemExit("usage: python -m tools.furniture_library FOLDER LIBRARY.sh3f...")
    folder, *libraries = map(Path, sys.argv[1:])
    number, skipped = unpack(libraries, folder)
    print("\n".join([*skipped, f"{folder}: {number} models, {len(skipped)} skipped; licences and creators are in catalogue.csv"]))


if __name__ == "__main__":
    main()
