"""Benchmarks import the project and each other without a cycle, never tests or tools; documents name existing ones."""

import ast
import re
from graphlib import TopologicalSorter

import pytest

from benchmarks.__main__ import NAMES, PEERS
from benchmarks.provenance import ROOT
from tests.test_documents import PAGES

FILES = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in (ROOT / "benchmarks").rglob("*.py")}


def imported(module: str) -> set[str]:
    """List the modules that a file imports, and possible modules of the packages that it imports from."""
    names = set()
    for node in ast.walk(ast.parse(FILES[module].read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def test_benchmarks_import_neither_tests_nor_tools():
    assert not [(module, name) for module in FILES for name in imported(module) if name.partition(".")[0] in ("tests", "tools")]


def test_imports_among_benchmarks_have_no_cycle():
    TopologicalSorter({module: imported(module) & FILES.keys() for module in FILES}).prepare()


def test_every_table_is_a_module():
    assert set(PEERS) < set(NAMES)
    assert {f"benchmarks.{name}" for name in NAMES} < FILES.keys()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_benchmarks_that_documents_name_exist(page):
    lines = [line for line in page.read_text().splitlines() if ", commit " not in line and "· commit " not in line]  # those name their own
    for name, tables in re.findall(r"python -m (benchmarks[\w.]*)((?: [a-z]+)*)", "\n".join(lines)):
        assert name in FILES or f"{name}.__main__" in FILES, name
        assert name != "benchmarks" or set(tables.split()) <= set(NAMES), tables
