"""The generated pages in `docs/` are what `make docs` writes; arrays and settings are complete."""

import re
from pathlib import Path

import pytest
import yaml

from pipeline.config.manifest import Manifest
from pipeline.formats.description_file import description_path
from pipeline.store.record import FolderRecord, RowRecord, ShardRecord
from schemas.catalogue import ARTIFACTS
from stages.registry import STAGES, load_stage
from tools.reference_pages import MARKER, PAGES, SITE_PAGES, regenerated

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("name", PAGES)
def test_reference_page_is_current(name):
    page = (DOCS / name).read_text()
    assert page == regenerated(page, PAGES[name]()), f"docs/{name} is out of date; run `make docs`"


def test_data_format_names_every_array_and_every_field_of_records():
    page = (DOCS / "data-format.md").read_text() + SITE_PAGES["data-format.md"]()
    arrays = {name for artifact in ARTIFACTS.values() for name in (*artifact.arrays, *artifact.ragged)}
    fields = {field for kind in (FolderRecord, RowRecord, ShardRecord) for field in kind.model_fields}
    assert not {name for name in arrays | fields if f"`{name}`" not in page}


def test_settings_page_names_every_setting():
    page = SITE_PAGES["settings.md"]()
    settings = {(name, field) for name in STAGES for field in load_stage(name).settings_type.model_fields}
    sections = dict(zip(STAGES, re.split("^## .*$", page, flags=re.MULTILINE)[1:], strict=True))
    assert not {(name, field) for name, field in settings if f"| `{field}` |" not in sections[name]}


def test_regenerating_keeps_text_above_the_marker_and_needs_a_marker():
    assert regenerated(f"# By hand\n{MARKER}old", "new") == f"# By hand\n{MARKER}\nnew"
    with pytest.raises(ValueError, match="has no line"):
        regenerated("# By hand\n", "new")


def test_hand_and_sensor_page_describes_every_entry_of_the_shipped_files():
    page = (DOCS / "hand-and-sensor.md").read_text()
    assert not re.findall(r"^\| `\w+` \|.*\|  \|$", page, re.MULTILINE)
    entries = set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    kinds = {
        "hand": ("allegro_right", "two_finger_gripper"),
        "sensor": ("gel_16mm", "gelsight", "gelsight_mini", "digit"),
        "scene": ("supplement",),
    }
    for kind, names in kinds.items():
        for name in names:
            assert set(yaml.safe_load(description_path(kind, name).read_text())) <= entries
    assert "its axis is y" in page


def test_manifests_page_names_every_entry_and_its_examples_are_manifests():
    page = (DOCS / "manifest.md").read_text()
    entries = [row for row in re.findall(r"^\| `\w+` \|.*$", page, re.MULTILINE) if "`kind`" not in row]
    assert {row for row in entries if row.endswith("|  |")} == set()  # each has a meaning
    whole, *sources = [yaml.safe_load(example) for example in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)]
    described = Manifest.model_validate(whole)
    kinds = [Manifest.model_validate(whole | {"sources": source}).sources[0].kind for source in sources]
    assert sorted(kinds) == ["catalogue", "directory", "procedural", "pybullet", "shapenet"]
    assert [source.kind for source in described.sources] == ["directory", "pybullet"]
