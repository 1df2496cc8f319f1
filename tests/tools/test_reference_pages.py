"""The generated pages in `docs/` are what `make docs` writes."""

import re
from pathlib import Path

import pytest
import yaml

from pipeline.config.manifest import Manifest
from pipeline.store.record import FolderRecord, RowRecord, ShardRecord
from schemas.catalogue import ARTIFACTS
from tools.reference_pages import MARKER, PAGES, regenerated

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("name", PAGES)
def test_reference_page_is_current(name):
    page = (DOCS / name).read_text()
    assert page == regenerated(page, PAGES[name]()), f"docs/{name} is out of date; run `make docs`"


def test_data_format_names_every_array_and_every_field_of_records():
    page = (DOCS / "data-format.md").read_text()
    arrays = {name for artifact in ARTIFACTS.values() for name in (*artifact.arrays, *artifact.ragged)}
    fields = {field for kind in (FolderRecord, RowRecord, ShardRecord) for field in kind.model_fields}
    assert not {name for name in arrays | fields if f"`{name}`" not in page}


def test_regenerating_keeps_what_is_above_the_marker_and_refuses_a_page_without_one():
    assert regenerated(f"# By hand\n{MARKER}old", "new") == f"# By hand\n{MARKER}\nnew"
    with pytest.raises(ValueError, match="has no line"):
        regenerated("# By hand\n", "new")


def test_manifests_page_names_every_entry_and_its_examples_are_manifests():
    page = (DOCS / "manifest.md").read_text()
    entries = [row for row in re.findall(r"^\| `\w+` \|.*$", page, re.MULTILINE) if "`kind`" not in row]
    assert {row for row in entries if row.endswith("|  |")} == set()  # each has a meaning
    whole, *sources = [yaml.safe_load(example) for example in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)]
    described = Manifest.model_validate(whole)
    kinds = [Manifest.model_validate(whole | {"sources": source}).sources[0].kind for source in sources]
    assert sorted(kinds) == ["catalogue", "directory", "procedural", "pybullet", "shapenet"]
    assert [source.kind for source in described.sources] == ["directory", "pybullet"]
