"""Pickles of plain values and arrays are read to the bit; whatever else they hold is refused, and nothing runs."""

import io
import pickle
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.formats import plain_pickle
from pipeline.formats.plain_pickle import read_plain_pickle

VALUES: dict[str, Any] = {
    "matrix": np.arange(6.0).reshape(2, 3),
    "columns first": np.asfortranarray(np.arange(6, dtype=">i4").reshape(2, 3)),
    "names": np.array(["x", "yy"]),
    "flags": np.array([True, False]),
    "scalar": np.float32(0.1),
    "nested": {"list": [1, 2.5, "t", None, True, (1, 2, 3, 4), -(2**40)], "objects": np.array([{"a": 1}, {}], object)},
}


@pytest.mark.parametrize("protocol", [3, 4])
def test_values_and_arrays_are_those_of_pickle(protocol: int) -> None:
    read = read_plain_pickle(pickle.dumps(VALUES, protocol))
    assert read.keys() == VALUES.keys()
    for name in list(VALUES)[:5]:
        np.testing.assert_array_equal(read[name], VALUES[name])
        assert np.asarray(read[name]).dtype.kind == np.asarray(VALUES[name]).dtype.kind
    assert read["nested"]["list"] == VALUES["nested"]["list"]
    assert read["nested"]["objects"].tolist() == [{"a": 1}, {}]


def test_array_that_is_named_twice_is_filled_once() -> None:
    array = np.arange(3)
    first, second = read_plain_pickle(pickle.dumps([array, array], 4))
    assert first is second
    assert first.tolist() == [0, 1, 2]


class Called:
    """Something that a pickle would make by calling a function."""

    def __reduce__(self) -> Any:
        return Path.touch, (Path("called"),)


@pytest.mark.parametrize("value", [Called(), Path("a"), OrderedDict(a=1), {1, 2}, np.array([], "M8[s]"), 1j, {1: "key"}])
def test_other_objects_are_refused_and_nothing_is_called(value: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInput, match="its pickle"):
        read_plain_pickle(pickle.dumps({"a": value}, 4))
    assert not list(tmp_path.iterdir())


def test_structured_arrays_are_refused() -> None:
    with pytest.raises(InvalidInput, match="its pickle"):
        read_plain_pickle(pickle.dumps(np.zeros(2, [("a", "f4")]), 4))


def array_pickle(shape: bytes, content: bytes, dtype: bytes = b"f8", twice: bool = False) -> bytes:
    """Write the pickle of an array, its state as given: a list, or bytes."""
    head = b"\x80\x03cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85C\x01b\x87R("
    state = b"K\x01" + shape + b"cnumpy\ndtype\nX" + len(dtype).to_bytes(4, "little") + dtype + b"\x89\x88\x87R\x89" + content + b"t"
    return head + state + (b"q\x00bh\x00" if twice else b"") + b"b."


def test_arrays_have_the_bytes_that_their_shape_says() -> None:
    eight = b"C\x08" + bytes(8)
    assert read_plain_pickle(array_pickle(b"K\x01\x85", eight)).tolist() == [0]
    for shape in (b"K\x02\x85", b"J\xff\xff\xff\x7f\x85", b"J\xff\xff\xff\xff\x85", b"\x88\x85", b"]", b"N"):
        with pytest.raises(InvalidInput, match="its pickle is damaged"):
            read_plain_pickle(array_pickle(shape, eight))


@pytest.mark.parametrize("sizes", [b"K\x01" * 40, b"\x8b\x80\x96\x98\x00" + b"\x7f" * 10_000_000 + b"q\x01" + b"h\x01" * 2000])
def test_shapes_are_not_multiplied_out_before_they_are_checked(sizes: bytes) -> None:
    with pytest.raises(InvalidInput, match="an array's shape is no tuple of at most 32 sizes"):
        read_plain_pickle(array_pickle(b"(" + sizes + b"t", b"C\x08" + bytes(8)))


def test_text_has_characters() -> None:
    """An array of text of no characters could have any shape."""
    with pytest.raises(InvalidInput, match="has a call that"):
        read_plain_pickle(array_pickle(b"J\xff\xff\xff\x7f\x85", b"C\x00", b"U0"))


def test_arrays_together_are_no_larger_than_the_file() -> None:
    with pytest.raises(InvalidInput, match="larger arrays than the file has bytes"):
        read_plain_pickle(array_pickle(b"K\xc8\x85", b"C\xc8" + bytes(200), b"u1", twice=True))


def test_steps_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plain_pickle, "MAX_STEPS", 100)
    with pytest.raises(InvalidInput, match="more than 100 steps"):
        read_plain_pickle(pickle.dumps([None] * 200, 4))


@pytest.mark.parametrize("end", range(0, 200, 7))
def test_pickles_that_are_cut_off_are_refused(end: int) -> None:
    stream = io.BytesIO()
    np.save(stream, np.array({"a": np.arange(3.0)}, dtype=object), allow_pickle=True)
    with pytest.raises(InvalidInput, match="its pickle"):
        read_plain_pickle(stream.getvalue()[128:][:end])
