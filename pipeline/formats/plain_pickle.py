"""Read pickles of plain values and NumPy arrays; nothing that a file names is imported or called.

`pickle.Unpickler` with another `find_class` does not bound what a file makes it allocate. The standard library's disassembler lists
the opcodes here, and a short interpreter follows those that `numpy.save` writes, in steps and bytes in proportion to the file.
"""

import math
import re
from dataclasses import dataclass
from pickletools import genops
from typing import Any, Literal

import numpy as np

from pipeline.errors import InvalidInput

MAX_STEPS = 2_000_000
"""Opcodes that are followed, 200 bytes of memory each at most: 5,000 grasps of DexGraspNet have 400,000."""
MAX_DIMS = 32  # of an array: the product of many large sizes would take hours
MODULES = ("numpy.core.multiarray", "numpy._core.multiarray")
"""Of NumPy 1 and 2, whose functions make arrays in pickles."""
NAMES = {
    "numpy ndarray": "ndarray",
    "numpy dtype": "dtype",
    **{f"{module} {name}": name for module in MODULES for name in ("_reconstruct", "scalar")},
}
"""What a pickle may name, as module and name: each stands for a few lines below."""
VALUES = {"BININT", "BININT1", "BININT2", "LONG1", "LONG4", "BINFLOAT", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8"}
VALUES |= {"BINBYTES", "SHORT_BINBYTES", "BINBYTES8"}
"""Opcodes whose argument is the value."""
CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False, "EMPTY_TUPLE": ()}
TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
DTYPES = re.compile(r"b1|[iu][1248]|f[248]|U[1-9][0-9]{0,3}|O8?")
MARK = object()


@dataclass(frozen=True)
class _Named:
    """What stands for a name of `NAMES`."""

    name: str


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
        return _Interpreter(content).run()
    except (ValueError, TypeError, IndexError, KeyError, OverflowError) as error:
        raise InvalidInput(f"its pickle is damaged, or of another kind than numpy.save writes ({error}); write it again as .npz") from error


class _Interpreter:
    """Follows the opcodes of one pickle."""

    def __init__(self, content: bytes) -> None:
        self.content, self.stack = content, list[Any]()
        self.memo: dict[int, Any] = {}
        self.bytes_left = len(content)  # that arrays may still take: each is in the file once

    def run(self) -> Any:
        """Follow all opcodes and return the value."""
        stack = self.stack
        for step, (opcode, argument, _) in enumerate(genops(self.content)):
            if step == MAX_STEPS:
                raise InvalidInput(f"its pickle has more than {MAX_STEPS} steps; split it into several files")
            name = opcode.name
            if name == "STOP":
                return stack.pop()
            if name in VALUES:
                stack.append(argument)
            elif name in CONSTANTS:
                stack.append(CONSTANTS[name])
            elif name in TUPLES:
                stack[-TUPLES[name] :] = [_taken(stack[-TUPLES[name] :], TUPLES[name])]
            elif name not in ("PROTO", "FRAME"):
                self._follow(name, argument)
        raise ValueError("it has no end")

    def _follow(self, name: str, argument: Any) -> None:
        """Follow an opcode that builds something of what is on the stack, or keeps it in the memo."""
        stack = self.stack
        match name:
            case "MARK":
                stack.append(MARK)
            case "EMPTY_LIST":
                stack.append([])
            case "EMPTY_DICT":
                stack.append({})
            case "TUPLE":
                stack.append(tuple(self._since_mark()))
            case "APPEND" | "APPENDS":
                items = self._since_mark() if name == "APPENDS" else [stack.pop()]
                _of_kind(stack[-1], list).extend(items)
            case "SETITEM" | "SETITEMS":
                items = self._since_mark() if name == "SETITEMS" else [stack.pop(-2), stack.pop()]
                if not all(isinstance(key, str) for key in items[::2]):
                    raise InvalidInput("its pickle has a dictionary whose keys are not text; write it again as .npz")
                _of_kind(stack[-1], dict).update(zip(items[::2], items[1::2], strict=True))
            case "BINPUT" | "LONG_BINPUT" | "MEMOIZE":
                self.memo[len(self.memo) if argument is None else argument] = stack[-1]
            case "BINGET" | "LONG_BINGET":
                stack.append(self.memo[argument])
            case "GLOBAL" | "STACK_GLOBAL":
                text = argument if name == "GLOBAL" else " ".join(_taken([stack.pop(-2), stack.pop()], 2))
                if text not in NAMES:
                    raise InvalidInput(f"its pickle names {text[:100]!r}; only NumPy arrays, numbers and text are read: write .npz")
                stack.append(_Named(NAMES[text]))
            case "REDUCE":
                arguments = stack.pop()
                stack.append(self._made(stack.pop(), *_of_kind(arguments, tuple)))
            case "BUILD":
                self._build(stack.pop(), stack[-1])
            case _:
                raise InvalidInput(f"its pickle has the opcode {name}, which numpy.save does not write for arrays; write it again as .npz")

    def _since_mark(self) -> list[Any]:
        items = []
        while (item := self.stack.pop()) is not MARK:
            items.append(item)
        return items[::-1]

    def _made(self, function: Any, *arguments: Any) -> Any:
        """Make what a function that the pickle names would return."""
        match function, arguments:
            case _Named("_reconstruct"), (_Named("ndarray"), (0,), b"b" | "b"):
                return np.empty(0)
            case _Named("dtype"), (str(code), False, True) if DTYPES.fullmatch(code):
                return _Dtype(code)
            case _Named("scalar"), (_Dtype() as dtype, bytes(content)):
                return self._fill(np.empty(0), (), dtype, content)[()]
        raise InvalidInput("its pickle has a call that numpy.save does not write for arrays of numbers or text; write it again as .npz")

    def _build(self, state: Any, target: Any) -> None:
        """Give a type its byte order, or an array its type, shape and elements."""
        match target, state:
            case _Dtype(), (3, "<" | ">" | "|" as order, None, None, None, *_):
                target.order = order
            case np.ndarray(), (1, shape, _Dtype() as dtype, bool(fortran), content):
                self._fill(target, shape, dtype, content, fortran=fortran)
            case _:
                raise InvalidInput("its pickle has an array with fields, or another object; write arrays of numbers or text as .npz")

    def _fill(self, array: np.ndarray, shape: Any, dtype: _Dtype, content: Any, *, fortran: bool = False) -> np.ndarray:
        """Fill an array of a shape whose elements are all in `content`."""
        kind = np.dtype(dtype.code).newbyteorder(dtype.order)
        if not (isinstance(shape, tuple) and len(shape) <= MAX_DIMS and all(type(size) is int and 0 <= size < 2**31 for size in shape)):
            raise ValueError(f"an array's shape is no tuple of at most {MAX_DIMS} sizes")
        held, size = (list, 1) if kind.hasobject else (bytes, kind.itemsize)
        if not isinstance(content, held) or len(content) != math.prod(shape) * size:
            raise ValueError("an array has fewer elements, or more, than its shape says")
        self.bytes_left -= len(content)
        if self.bytes_left < 0:
            raise InvalidInput("its pickle makes larger arrays than the file has bytes; write it again as .npz")
        array.__setstate__((1, shape, kind, fortran, content))  # type: ignore[arg-type]  # it takes no np.bool
        return array


def _of_kind(target: Any, kind: type) -> Any:
    if not isinstance(target, kind):
        raise ValueError(f"it has something else in the place of a {kind.__name__}")
    return target


def _taken(items: list[Any], count: int) -> tuple[Any, ...]:
    if len(items) != count or any(item is MARK for item in items):
        raise ValueError("it takes more than there is")
    return tuple(items)
