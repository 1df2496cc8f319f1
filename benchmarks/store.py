"""A shard of touches beside .npy files and HDF5."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from pydantic_zarr.v3 import ArraySpec
from zarr.storage import LocalStore

from benchmarks.timing import Table, over_items, side_by_side, three_digits
from pipeline.store.directory import DataDirectory
from pipeline.store.layout import array_metadata
from schemas.touch import TOUCH

OURS, NPY, HDF5 = "Zarr, as stored (ours)", ".npy, one file per array", "HDF5, gzip and shuffle"
MAPS = tuple(
    name
    for name, array in TOUCH.arrays.items()
    if array.dims[:3] == ("object", "grasp", "sensor") and "row" in array.dims and not array.optional
)
"""Depth maps and tactile images."""
GRASP = (0, 0)
"""Object and grasp that are read alone."""
Arrays = dict[str, np.ndarray]


Format = tuple[Callable[[Path, Arrays], object], Callable[[Path], AbstractContextManager[Mapping[str, Any]]]]
"""A function that writes arrays to a folder, and one that opens them by name."""


def measure(data: Path, turns: int) -> Table:
    """Measure the first shard of touches in `data`, `turns` rounds of every format."""
    shard = DataDirectory(data).collection(TOUCH).first
    arrays = {name: np.asarray(shard.read(name)) for name in TOUCH.arrays if shard.has(name)}
    arrays = {name: array for name, array in arrays.items() if array.dtype.kind in "biuf"}  # not strings
    objects, grasps = arrays[MAPS[0]].shape[:2]
    table = Table(
        "A shard of touches on disk",
        ["bytes per grasp", "÷ ours", "files", "write, ms", "÷ ours", "read, ms", "÷ ours", "one grasp, ms"],
        [
            f"{', '.join(sorted(arrays))} of {objects} objects × {grasps} grasps, "
            f"{sum(array.nbytes for array in arrays.values()) / 1e6:.1f} MB in memory. Processor milliseconds of one core, least / median; "
            "ratios of the least. Files lie in the page cache: the cost of a disk or a network goes with the bytes and the number of "
            "files. One grasp: the depth maps and tactile images of its sensors, opening the store included.",
            "All hold the same arrays to the bit, read back and compared. Ours has checksums, units, dimension names and meanings beside "
            "them; .npy files and HDF5 as written here have none.",
            "HDF5 by h5py, chunks of a grasp as ours, gzip's default level 4 behind the shuffle filter; other filters need plugins.",
        ],
    )
    compare(table, formats(table), arrays, turns)
    return table


def formats(table: Table) -> dict[str, Format]:
    """List the formats that are installed."""

    def open_npy(folder: Path) -> AbstractContextManager[Mapping[str, Any]]:
        return nullcontext({path.stem: np.load(path, mmap_mode="r") for path in folder.glob("*.npy")})

    def open_zarr(folder: Path) -> AbstractContextManager[Mapping[str, Any]]:
        group: Any = zarr.open_group(str(folder / "touch.zarr"), mode="r")
        return nullcontext(group)

    available: dict[str, Format] = {
        OURS: (_write_zarr, open_zarr),
        NPY: (_write_npy, open_npy),
    }
    with table.peer(HDF5):
        import h5py

        def write_hdf5(folder: Path, arrays: Arrays) -> None:
            with h5py.File(folder / "touch.h5", "w") as file:
                for name, array in arrays.items():
                    chunks = (1, 1, *array.shape[2:]) if name in MAPS else True
                    file.create_dataset(name, data=array, chunks=chunks, compression="gzip", shuffle=True)

        available[HDF5] = write_hdf5, lambda folder: h5py.File(folder / "touch.h5", "r")
    return available


def compare(table: Table, formats: dict[str, Format], arrays: Arrays, turns: int) -> None:
    """Add a row per format, which is written, read back and compared."""
    with tempfile.TemporaryDirectory() as temporary:
        folders = {name: Path(temporary) / str(number) for number, name in enumerate(formats)}
        for folder in folders.values():
            folder.mkdir()
        operations: tuple[Callable[[str], object], ...] = (
            lambda name: formats[name][0](folders[name], arrays),
            lambda name: _read(*formats[name], folders[name], list(arrays), ...),
            lambda name: _read(*formats[name], folders[name], MAPS, GRASP),
        )
        write_times, read_times, grasp_times = (
            side_by_side({name: over_items(operation, [name]) for name in formats}, turns) for operation in operations
        )
        sizes = {name: [path.stat().st_size for path in folder.rglob("*") if path.is_file()] for name, folder in folders.items()}
        for name in formats:
            for keys, index in ((list(arrays), ...), (MAPS, GRASP)):
                for key, array in zip(keys, _read(*formats[name], folders[name], keys, index), strict=True):
                    if not np.array_equal(array, arrays[key][index]):
                        raise ValueError(f"{name} does not give {key} back as written")
            per_grasp = sum(sizes[name]) / int(np.prod(arrays[MAPS[0]].shape[:2]))
            table.add(
                *(name, f"{per_grasp:,.0f}", f"{sum(sizes[name]) / sum(sizes[OURS]):.2f}", len(sizes[name])),
                *(write_times[name], write_times[name].over(write_times[OURS]), read_times[name], read_times[name].over(read_times[OURS])),
                three_digits(grasp_times[name].least),
            )


def _read(_write: object, opened: Any, folder: Path, names: Sequence[str], index: Any) -> list[np.ndarray]:
    with opened(folder) as arrays:
        return [np.array(arrays[name][index]) for name in names]


def _write_zarr(folder: Path, arrays: Arrays) -> None:
    store = LocalStore(folder / "touch.zarr")
    zarr.create_group(store, overwrite=True)
    for name, array in arrays.items():
        stored: Any = ArraySpec(**array_metadata(TOUCH.arrays[name], array.shape)).to_zarr(store, path=name)
        stored[...] = array


def _write_npy(folder: Path, arrays: Arrays) -> None:
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)
