"""Benchmarks import the project, never the tests."""

from __future__ import annotations

import ast

from benchmarks.provenance import ROOT


def test_benchmarks_do_not_import_tests():
    for path in (ROOT / "benchmarks").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [name for name in names if name.partition(".")[0] == "tests"], path
