"""Rows, one object's part of an artifact: digests, and checks against the schema."""

from collections.abc import Mapping

import numpy as np

from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.record import Failure
from pipeline.store.spec import numpy_dtype
from schemas.base import COMMON, Array, Artifact

Row = dict[str, np.ndarray]
"""One object's part of every array of an artifact, without the object dimension; ragged ones as `meshes/vertices`."""


def row_digest(row: Mapping[str, np.ndarray], failure: Failure | None, category: str) -> str:
    """Compute the digest of an object's category and row, or failure."""
    return digest.of_arrays({} if failure else row, failure=failure and failure.model_dump(), category=category)


def are_valid(array: Array, values: np.ndarray) -> bool:
    """Check that floats are finite, or +inf where the declaration allows it; other values are always valid."""
    return values.dtype.kind != "f" or bool((values > -np.inf if array.infinite else np.isfinite(values)).all())


def conform(artifact: Artifact, row: Mapping[str, np.ndarray], *, constants: bool = False) -> Row:
    """Check a row, or the constants, against the schema, and convert it to the schema's dtypes.

    A `StoreError` names an array that is missing, unknown, has the wrong number of dimensions or kind, or holds a value
    that is not finite (+inf may be allowed).
    """
    declared = {name: array for name, array in artifact.arrays.items() if name not in COMMON and array.per_object != constants}
    optional = {name for name, array in declared.items() if array.optional}
    if missing := sorted(declared.keys() - row.keys() - optional):
        raise StoreError(f"{artifact.name}: the stage returned no {', '.join(missing)}")
    conformed: Row = {}
    for name, value in row.items():
        array = declared.get(name) or (artifact.of(name) if "/" in name else None)
        if array is None:
            raise StoreError(f"{artifact.name}: the stage returned {name}, which is not in its schema")
        dims = array.dims[1:] if array.per_object else array.dims
        if value.ndim != len(dims):
            raise StoreError(f"{artifact.name}: {name} has shape {value.shape}, the schema says {dims}")
        dtype = np.dtype(np.str_) if array.dtype == "string" else numpy_dtype(array)
        if not np.can_cast(value.dtype, dtype, "same_kind"):
            raise StoreError(f"{artifact.name}: {name} is {value.dtype}, the schema says {array.dtype}")
        with np.errstate(over="ignore"):  # values beyond float32 become infinite, and are refused below
            stored = value if array.dtype == "string" else value.astype(dtype)
        if not are_valid(array, stored):
            raise StoreError(f"{artifact.name}: {name} holds a value that is not finite as {array.dtype}; a kernel let it through")
        conformed[name] = stored
    return conformed
