"""Read and write `tradeoff.json`: the studies that `vt-pipeline` quotes, and the sections of `docs/tradeoff.md` beside them."""

from __future__ import annotations

import json
from typing import Any

from benchmarks.provenance import ROOT
from pipeline.tradeoff.measurements import ASSET, load_studies

PATH = ROOT / "pipeline" / "tradeoff" / ASSET
SECTIONS = ("same", "end_to_end", "alternatives", "shortcuts", "sensors")


def read_figures() -> dict[str, Any]:
    """Read what was measured last: "studies" and "sections" by name, each with its provenance."""
    content: dict[str, Any] = json.loads(PATH.read_text()) if PATH.exists() else {"studies": {}, "sections": {}}
    return content


def section_rows(figures: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """Take the rows of a section; none where it was not measured yet."""
    rows: list[dict[str, Any]] = figures["sections"].get(name, {"rows": []})["rows"]
    return rows


def write_figures(figures: dict[str, Any]) -> None:
    """Write the figures where the package finds them."""
    PATH.write_text(json.dumps(figures, indent=1, allow_nan=False) + "\n")
    load_studies.cache_clear()
