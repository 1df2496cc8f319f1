"""The card and the Croissant metadata of an export; `mlcroissant` and `datasets` read them in `read_back.py`."""

import hashlib
import json
import re
from pathlib import Path

import pytest
import yaml

from pipeline.contrib.exports.dataset_card import About, Facts, card, write_card, write_croissant
from pipeline.contrib.exports.grasp_frames import GraspFrames
from pipeline.formats.description_file import read_description
from schemas.touch import TOUCH
from tests.stages import ball_dataset

ABOUT = {
    **{"title": "Balls | to <touch>", "description": "Four balls.", "creators": ["A. Person"], "url": "https://example.org/balls"},
    **{"licence": "https://spdx.org/licenses/CC0-1.0", "published": "2026-11-26"},
}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    ball_dataset.make_data(folder, 3, ("train", "test"))
    return folder


@pytest.fixture(scope="module")
def facts(data: Path) -> Facts:
    return Facts(data, GraspFrames(data))


def test_card_has_statistics_licences_columns_and_hub_metadata(data: Path, facts: Facts, tmp_path: Path) -> None:
    write_card(data, facts, About.model_validate(ABOUT), tmp_path)
    text = (tmp_path / "README.md").read_text()
    _, head, body = text.split("---\n", 2)
    (config,) = yaml.safe_load(head)["configs"]
    assert config["data_files"] == [{"split": name, "path": f"data/{name}.parquet"} for name in ("train", "test")]
    assert "# Balls \\| to &lt;touch>" in body
    assert "15 grasps, a row each, of 3 objects." in body
    assert "| train | 2 | 10 |" in body
    assert "hold float64 arrays as float32" in body
    assert "| bottle | 2 | 10 | 40 | 75.0 |" in body
    assert "| not recorded | 3 |" in body
    assert "| `depth.finger-0` | float32 | 100 × 100 | m | D: distance" in body
    picture = re.search(r"!\[.*\]\((.*)\)", body)
    assert picture
    assert (tmp_path / picture[1]).read_bytes().startswith(b"\x89PNG")


def test_croissant_names_files_with_their_hashes_and_each_column_with_its_unit(facts: Facts, tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    for split in facts.grasps:
        (tmp_path / "data" / f"{split}.parquet").write_bytes(split.encode())
    write_croissant(facts, About.model_validate(ABOUT), tmp_path)
    metadata = json.loads((tmp_path / "croissant.json").read_text())
    assert metadata["conformsTo"][0] == "http://mlcommons.org/croissant/1.1"
    assert (metadata["url"], metadata["datePublished"], metadata["creator"][0]["name"]) == (ABOUT["url"], "2026-11-26", "A. Person")
    assert [file["sha256"] for file in metadata["distribution"]] == [hashlib.sha256(split.encode()).hexdigest() for split in facts.grasps]
    for records in metadata["recordSet"]:
        fields = {field["name"]: field for field in records["field"]}
        assert fields.keys() == facts.columns.keys()
        depth = fields["depth.finger-1"]
        assert depth["annotation"]["value"] == TOUCH.arrays["depth"].units == "m"
        assert (depth["isArray"], depth["arrayShape"]) == (True, "100,100")


def test_facts_that_the_publisher_does_not_state_are_left_out(facts: Facts, tmp_path: Path) -> None:
    text = card(facts, About(), picture=False)
    assert "the publisher states none" in text
    assert "# balls" in text
    (tmp_path / "about.yaml").write_text("tilte: x\n")
    with pytest.raises(ValueError, match="there is no entry tilte, did you mean title"):
        read_description("about", tmp_path / "about.yaml", About)
