"""Read pickles of plain values and NumPy arrays; nothing that a file names is imported or called.

The standard library's unpickler follows the file, in Python: the one in C takes any number for the memo's size and any value as a key.
Opcodes are counted and checked before; what stands for NumPy's functions is below.
"""

import io
import math
import pickle
import re
from collections.abc import Callable
from dataclasses import dataclass
from pickletools import genops
from typing import Any, ClassVar, Literal

import numpy as np

from pipeline.errors import InvalidInput

MAX_STEPS = 2_000_000  # opcodes that are followed, 200 bytes of memory each at most: 5,000 grasps of DexGraspNet have 400,000
MAX_DIMS = 32  # of an array: the product of many large sizes would take hours
OPCODES = re.compile(  # those that `numpy.save` writes for plain values and arrays
    "PROTO|FRAME|STOP|MARK|NONE|NEWTRUE|NEWFALSE|BININT[12]?|LONG[14]|BINFLOAT|(SHORT_)?BIN(UNICODE|BYTES)|BIN(UNICODE|BYTES)8"
    "|(EMPTY_)?TUPLE|TUPLE[123]|EMPTY_(LIST|DICT)|APPENDS?|SETITEMS?|(LONG_)?BIN(PUT|GET)|MEMOIZE|(STACK_)?GLOBAL|REDUCE|BUILD"
)
NAMES = {"numpy": ("ndarray", "dtype")} | dict.fromkeys(("numpy.core.multiarray", "numpy._core.multiarray"), ("_reconstruct", "scalar"))
"""What a pickle may name, by module, of NumPy 1 and 2; its text stands for it."""
DTYPES = re.compile(r"b1|[iu][1248]|f[248]|U[1-9][0-9]{0,3}|O8?")
REMEDY = "write it again as .npz"


@dataclass
class _Dtype:
    """A type of array elements; a pickle states its byte order after it has made it."""

    code: str
    order: Literal["=", "<", ">", "|"] = "="


def read_plain_pickle(content: bytes) -> Any:
    """Read a pickle of dictionaries with text as keys, lists, tuples, text, numbers and arrays.

    An `InvalidInput` says what else it holds.
    """
    try:
        for step, (opcode, _, _) in enumerate(genops(content)):
            if not OPCODES.fullmatch(opcode.name):
                raise InvalidInput(f"its pickle has the opcode {opcode.name}, which numpy.save does not write for arrays; {REMEDY}")
            if step == MAX_STEPS:
                raise InvalidInput(f"its pickle has more than {MAX_STEPS} steps; split it into several files")
        return _Unpickler(content).load()
    except InvalidInput:
        raise
    except Exception as error:  # the unpickler raises whatever it trips over
        raise InvalidInput(f"its pickle is damaged, or of another kind than numpy.save writes ({error}); {REMEDY}") from error


class _Unpickler(pickle._Unpickler):
    """Follows a pickle; lookups, calls, states of objects and entries of dictionaries are its own."""

    stack: list[Any]
    pop_mark: Callable[[], list[Any]]

    def __init__(self, content: bytes) -> None:
        super().__init__(io.BytesIO(content))
        self.bytes_left = len(content)  # that arrays may still take: each is in the file once

    def find_class(self, module: str, name: str) -> str:
        if name not in NAMES.get(module, ()):
            raise InvalidInput(f"its pickle names {f'{module} {name}'[:100]!r}; only NumPy arrays, numbers and text are read: write .npz")
        return name

    def load_reduce(self) -> None:
        """Make what a function that the pickle names would return."""
        arguments, function = self.stack.pop(), self.stack.pop()
        match function, *arguments:
            case "_reconstruct", "ndarray", (0,), b"b" | "b":
                made: Any = np.empty(0)
            case "dtype", str(code), False, True if DTYPES.fullmatch(code):
                made = _Dtype(code)
            case "scalar", _Dtype() as dtype, bytes(content):
                made = self.fill(np.empty(0), (), dtype, content)[()]
            case _:
                raise InvalidInput(f"its pickle has a call that numpy.save does not write for arrays of numbers or text; {REMEDY}")
        self.stack.append(made)

    def load_build(self) -> None:
        """Give a type its byte order, or an array its type, shape and elements."""
        match self.stack.pop(), self.stack[-1]:
            case (3, "<" | ">" | "|" as order, None, None, None, *_), _Dtype() as dtype:
                dtype.order = order
            case (1, shape, _Dtype() as dtype, bool(fortran), content), np.ndarray() as array:
                self.fill(array, shape, dtype, content, fortran=fortran)
            case _:
                raise InvalidInput("its pickle has an array with fields, or another object; write arrays of numbers or text as .npz")

    def load_setitem(self) -> None:
        self._set(self.stack.pop(-2), self.stack.pop())

    def load_setitems(self) -> None:
        self._set(*self.pop_mark())

    def _set(self, *items: Any) -> None:
        if not (isinstance(self.stack[-1], dict) and all(isinstance(key, str) for key in items[::2])):
            raise InvalidInput(f"its pickle has a dictionary whose keys are not text; {REMEDY}")
        self.stack[-1].update(zip(items[::2], items[1::2], strict=True))

    def fill(self, array: np.ndarray, shape: Any, dtype: _Dtype, content: Any, *, fortran: bool = False) -> np.ndarray:
        """Fill an array of a shape whose elements are all in `content`."""
        kind = np.dtype(dtype.code).newbyteorder(dtype.order)
        if not (isinstance(shape, tuple) and len(shape) <= MAX_DIMS and all(type(size) is int and 0 <= size < 2**31 for size in shape)):
            raise ValueError(f"an array's shape is no tuple of at most {MAX_DIMS} sizes")
        held, size = (list, 1) if kind.hasobject else (bytes, kind.itemsize)
        if not isinstance(content, held) or len(content) != math.prod(shape) * size:
            raise ValueError("an array has fewer elements, or more, than its shape says")
        self.bytes_left -= len(content)
        if self.bytes_left < 0:
            raise InvalidInput(f"its pickle makes larger arrays than the file has bytes; {REMEDY}")
        array.__setstate__((1, shape, kind, fortran, content))  # type: ignore[arg-type]  # it takes no np.bool
        return array

    dispatch: ClassVar[dict[int, Callable[..., None]]] = pickle._Unpickler.dispatch | {
        pickle.REDUCE[0]: load_reduce,
        pickle.BUILD[0]: load_build,
        pickle.SETITEM[0]: load_setitem,
        pickle.SETITEMS[0]: load_setitems,
    }
