"""Mutations of files: of their bytes, and of the tree in their JSON or YAML."""

import json
import math
import random
from contextlib import suppress
from typing import Any

import yaml

NASTY: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 0.5, -0.0, 1e-300, 1e300, 1e-45, 3.4e38, math.inf, -math.inf, math.nan),
    *(2**31 - 1, 2**31, 2**32, 2**63, 2**64, -(2**63), 10**30, 65536, 100_000),
    *(
        "",
        " ",
        ".",
        "..",
        "/",
        "../../../outside.png",
        "/dev/null",
        "~",
        "%00",
        "a\0b",
        "\x1b[31mred\x1b[0m",
        "\u202e",
        "é" * 40,
    ),
    *("x" * 10_000, "nan", "1e400", "0x10", "data:;base64,AAAA", "file:///outside.png", "[bold]", "${HOME}", "-", "--help"),
    *(
        [],
        {},
        [[]],
        [[[[[[[]]]]]]],
        [0] * 1000,
        {"a": {"b": {"c": {}}}},
        [None],
        [math.nan, math.nan, math.nan],
        [0.0, 0.0, 0.0],
        [1e200] * 3,
    ),
)
WORDS = tuple(
    word.encode()
    for word in (
        *(
            "0",
            "-1",
            "1e999",
            "nan",
            "inf",
            "99999999999",
            "4294967296",
            "1/1/1",
            "1//",
            "-1/-1",
            "\0",
            "\r",
            "\n\n",
            "{",
            "}",
            "[" * 50,
            '"',
        ),
        *("v nan nan nan\n", "f 1 2 3\n", "f 1 1 1\n", "f 0 1 2\n", "f -1 -2 -3\n", "f 1 2 3 4 5 6 7\n", "usemtl x\n", "mtllib ../x.mtl\n"),
        *(
            "mtllib /dev/null\n",
            "element face 13\n",
            "element vertex 0\n",
            "property list uchar int vertex_indices\n",
            "end_header\n",
        ),
        *(
            "map_Kd ../../secret.png\n",
            "facet normal 0 0 0\n",
            "OFF\n",
            "<robot/>",
            "<!-- a -->",
            "xyz=",
            "rpy='1 2'",
            "\x1b[2J",
            "&a [*a]",
            "<library_nodes>",
            '<component objectid="2"/>',
            '<vertex x="0" y="0" z="0"/>',
            'count="25"',
            "PK\5\6",
        ),
        *("<<: *a\n", "<<: {name: x}\n", "? [a, b]\n: c\n", "&a ", "*a", "--- \n", "...\n", "%YAML 9.9\n---\n", "\t", "|\n", ">-\n"),
        *("!!python/tuple [a] ", "!!binary x", "!!set {a} ", "!!float x ", "!!int 1:30:00", "2001-99-99"),
        *("%TAG ! tag:x,2000:\n", "0o777", "1_000", ".inf", ".nan", "~", "yes", "- " * 60, "{a: " * 60, "\ufeff", "\u2028"),
    )
)


def mutated(content: bytes, others: list[bytes], rng: random.Random, *, tree: bool) -> bytes:
    """Mutate a file by one to four changes, some of them in its tree if it has one, else in its bytes."""
    if tree and len(content) < 10_000 and rng.random() < 0.6:
        with suppress(yaml.YAMLError, ValueError, RecursionError):  # an earlier change may leave no tree, or a cyclic one
            root = yaml.load(content, Loader=yaml.CSafeLoader)
            if isinstance(root, dict | list):
                for _ in range(rng.choice((1, 1, 1, 2, 3))):
                    root = _changed(root, rng)
                return json.dumps(root, default=str).encode()
    for _ in range(rng.choice((1, 1, 2, 4))):
        content = rng.choice(BYTES)(content, others, rng)
    return content


def _changed(node: Any, rng: random.Random) -> Any:
    """Replace, remove, double or wrap one node of a tree."""
    if not isinstance(node, dict | list) or not node or rng.random() < 0.15:
        return rng.choice((*NASTY, [node], {"name": node}, [node] * 3))
    keys = list(node) if isinstance(node, dict) else range(len(node))
    key = rng.choice(keys)
    node = dict(node) if isinstance(node, dict) else list(node)
    if rng.random() < 0.7:
        node[key] = _changed(node[key], rng)
    elif isinstance(node, dict):
        value = node.pop(key)
        if rng.random() < 0.5:
            node[rng.choice(("", "name", "x\x1b", str(key).upper(), "a/b", "9"))] = value
    elif rng.random() < 0.5:
        del node[key]
    else:
        node += [node[key]] * rng.choice((1, 2, 100))
    return node


def _flip(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    changed = bytearray(content or b"\0")
    for _ in range(rng.choice((1, 1, 2, 8))):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _cut(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    start, stop = sorted(rng.randrange(len(content) + 1) for _ in range(2))
    return rng.choice((content[:start], content[start:], content[:start] + content[stop:]))


def _insert(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    return content[:at] + rng.choice(WORDS) * rng.choice((1, 1, 1, 100)) + content[at:]


def _replace_token(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    tokens = content.split(b" ")
    tokens[rng.randrange(len(tokens))] = rng.choice(WORDS)
    return b" ".join(tokens)


def _lines(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    lines = content.split(b"\n")
    at = rng.randrange(len(lines))
    match rng.randrange(3):
        case 0:
            lines.insert(rng.randrange(len(lines)), lines[at])
        case 1:
            del lines[at]
        case _:
            lines[at : at + 1] = [lines[at]] * rng.choice((2, 50))
    return b"\n".join(lines)


def _number(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    """Overwrite a four-byte field of a binary format."""
    at = rng.randrange(max(1, len(content) - 3))
    value = rng.choice((0, 1, 255, 65535, len(content)))
    return content[:at] + value.to_bytes(4, rng.choice(("little", "big"))) + content[at + 4 :]


def _splice(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    other = rng.choice(others)
    return content[: rng.randrange(len(content) + 1)] + other[rng.randrange(len(other) + 1) :]


def _other(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    return rng.choice((*others, b"", b"\0" * 100, b"[" * 2000, b"<a>" * 100))


BYTES = (_flip, _flip, _cut, _insert, _insert, _replace_token, _lines, _lines, _number, _splice, _other)
