"""One shard of touches: beside .npy files and HDF5."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zarr
from zarr.storage import LocalStore

from benchmarks.peers.table import Table
from benchmarks.timing import each, side_by_side, three_digits
from pipeline.store.directory import DataDirectory
from pipeline.store.spec import group_spec
from schemas.touch import TOUCH

OURS = "Zarr, as stored (ours)"
MAPS = ("depth", "reading")
Arrays = dict[str, np.ndarray]
GRASP = (0, 0)
"""Object and grasp of the one that is read alone."""


@dataclass(frozen=True)
class Format:
    """How arrays are written to a folder, read whole, and one grasp's maps of them read."""

    write: Callable[[Path, Arrays], None]
    whole: Callable[[Path], Arrays]
    grasp: Callable[[Path], list[np.ndarray]]


def measure(data: Path, turns: int) -> Table:
    """The table, of the first shard of touches in `data`; `turns` rounds of every format."""
    shard = DataDirectory(data).collection(TOUCH).first
    arrays = {
        name: np.asarray(shard.array(name)[...])
        for name in TOUCH.arrays
        if name in shard.group and name not in ("object_id", "category", "split")
    }
    grasps = int(np.prod(arrays["depth"].shape[:2]))
    raw = sum(array.nbytes for array in arrays.values())
    table = Table(
        "A shard of touches on disk",
        ["bytes per grasp", "÷ ours", "files", "write, ms", "÷ ours", "read, ms", "÷ ours", "one grasp, ms"],
        [
            f"{', '.join(sorted(arrays))} of {len(shard.object_ids)} objects × {arrays['depth'].shape[1]} grasps, "
            f"{raw / 1e6:.1f} MB in memory. Processor milliseconds of one core, least / median; ratios of the least. Files lie in the page "
            "cache: what a disk or a network adds goes with the "
            "bytes and the number of files. One grasp: its four depth maps and readings, opening the store included.",
            "All hold the same arrays to the bit, read back and compared. Ours has checksums, units, dimension names and meanings beside "
            "them, .npy files and HDF5 as written here have none.",
            "HDF5 by h5py, chunks of a grasp as ours, gzip's default level 4 behind the shuffle filter; other filters need plugins. "
            "One .npy file per array and grasp is much as the paper's authors store theirs.",
        ],
    )
    formats = {OURS: Format(_write_zarr, _read_zarr, _grasp_zarr), ".npy, one file per array": Format(_write_npy, _read_npy, _grasp_npy)}
    formats[".npy, one file per array and grasp"] = Format(_write_small, _read_small, _grasp_small)
    try:
        import h5py  # noqa: F401

        formats["HDF5, gzip and shuffle"] = Format(_write_hdf5, _read_hdf5, _grasp_hdf5)
    except ImportError as error:
        table.could_not_run("HDF5, gzip and shuffle", f"{error}; `make bench-peers` installs it")
    compare(table, formats, arrays, turns, grasps)
    return table


def compare(table: Table, formats: dict[str, Format], arrays: Arrays, turns: int, grasps: int) -> None:
    """A row a format, which is written, read back and compared, in a folder that is removed again.

    Raises
    ------
    ValueError
        A format does not give the arrays back to the bit.
    """
    with tempfile.TemporaryDirectory() as folder:
        _compare(table, formats, arrays, Path(folder), turns, grasps)


def _compare(table: Table, formats: dict[str, Format], arrays: Arrays, folder: Path, turns: int, grasps: int) -> None:
    places = {name: folder / str(number) for number, name in enumerate(formats)}
    for place in places.values():
        place.mkdir()
    write = side_by_side({name: each(lambda a, n=name, f=f: f.write(places[n], a), [arrays]) for name, f in formats.items()}, turns)
    whole = side_by_side({name: each(f.whole, [places[name]]) for name, f in formats.items()}, turns)
    grasp = side_by_side({name: each(f.grasp, [places[name]]) for name, f in formats.items()}, turns)
    sizes = {name: [path.stat().st_size for path in place.rglob("*") if path.is_file()] for name, place in places.items()}
    for name, form in formats.items():
        _same(name, form, places[name], arrays)
        table.add(
            name,
            f"{sum(sizes[name]) / grasps:,.0f}",
            f"{sum(sizes[name]) / sum(sizes[OURS]):.2f}",
            str(len(sizes[name])),
            str(write[name]),
            f"{write[name].least / write[OURS].least:.2f}",
            str(whole[name]),
            f"{whole[name].least / whole[OURS].least:.2f}",
            three_digits(grasp[name].least),
        )


def _same(name: str, form: Format, place: Path, arrays: Arrays) -> None:
    """Raise where a format did not keep every bit."""
    found = form.whole(place)
    for key, array in arrays.items():
        if not np.array_equal(found[key], array):
            raise ValueError(f"{name} does not give {key} back as it was written")
    for map_name, one in zip(MAPS, form.grasp(place), strict=True):
        if not np.array_equal(one, arrays[map_name][GRASP]):
            raise ValueError(f"{name} does not give {map_name} of grasp {GRASP} back as it was written")


def _write_zarr(folder: Path, arrays: Arrays) -> None:
    group = group_spec(TOUCH, {name: array.shape for name, array in arrays.items()}, {}).to_zarr(
        LocalStore(folder / "touch.zarr"), path="", overwrite=True
    )
    for name, array in arrays.items():
        group[name][...] = array


def _read_zarr(folder: Path) -> Arrays:
    group = zarr.open_group(str(folder / "touch.zarr"), mode="r")
    return {name: np.asarray(group[name][...]) for name in group.array_keys()}


def _grasp_zarr(folder: Path) -> list[np.ndarray]:
    group = zarr.open_group(str(folder / "touch.zarr"), mode="r")
    return [np.asarray(group[name][GRASP]) for name in MAPS]


def _write_npy(folder: Path, arrays: Arrays) -> None:
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)


def _read_npy(folder: Path) -> Arrays:
    return {path.stem: np.load(path) for path in folder.glob("*.npy")}


def _grasp_npy(folder: Path) -> list[np.ndarray]:
    return [np.array(np.load(folder / f"{name}.npy", mmap_mode="r")[GRASP]) for name in MAPS]


def _write_small(folder: Path, arrays: Arrays) -> None:
    _write_npy(folder, {name: array for name, array in arrays.items() if name not in MAPS})
    for name in MAPS:
        for index in np.ndindex(arrays[name].shape[:2]):
            np.save(folder / _small(name, index), arrays[name][index])


def _read_small(folder: Path) -> Arrays:
    arrays = {path.stem: np.load(path) for path in folder.glob("*.npy") if "-" not in path.stem}
    for name in MAPS:
        indices = np.array([[int(part) for part in path.stem.split("-")[1:]] for path in folder.glob(f"{name}-*.npy")])
        shape = tuple(indices.max(axis=0) + 1)
        parts = [np.load(folder / _small(name, index)) for index in np.ndindex(shape)]
        arrays[name] = np.stack(parts).reshape(*shape, *parts[0].shape)
    return arrays


def _grasp_small(folder: Path) -> list[np.ndarray]:
    return [np.load(folder / _small(name, GRASP)) for name in MAPS]


def _small(name: str, index: tuple[int, ...]) -> str:
    return f"{name}-{index[0]}-{index[1]}.npy"


def _write_hdf5(folder: Path, arrays: Arrays) -> None:
    import h5py

    with h5py.File(folder / "touch.h5", "w") as file:
        for name, array in arrays.items():
            chunks = (1, 1, *array.shape[2:]) if name in MAPS else True
            file.create_dataset(name, data=array, chunks=chunks, compression="gzip", shuffle=True)


def _read_hdf5(folder: Path) -> Arrays:
    import h5py

    with h5py.File(folder / "touch.h5", "r") as file:
        return {name: file[name][...] for name in file}


def _grasp_hdf5(folder: Path) -> list[np.ndarray]:
    import h5py

    with h5py.File(folder / "touch.h5", "r") as file:
        return [file[name][GRASP] for name in MAPS]
