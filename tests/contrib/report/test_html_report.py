"""Pages of a report: files outside their folder are kept, and damaged pages are found and written again."""

import json
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.console import Table
from pipeline.contrib.report import figures
from pipeline.contrib.report.html_report import _environment
from pipeline.contrib.report.object_page import Pages, columns
from pipeline.contrib.report.report_source import ReportSource
from pipeline.drawing.written_files import read_list
from pipeline.errors import StoreError
from tests.command_line import vt
from tests.engine.tiny_stages import publish
from tests.stages import ball_dataset
from tests.store.test_validate import resealed


@pytest.fixture(scope="module", autouse=True)
def no_figures() -> Iterator[None]:
    """Skip the paper's figures: they take seconds, and are files of a report like others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.contrib.report.html_report.draw_figures", lambda *_: [])
        patch.setattr("pipeline.contrib.report.html_report.overview_panels", lambda *_: [])
        yield


@pytest.fixture(scope="module")
def report_data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    ball_dataset.make_data(folder, 1)
    vt("report", folder)
    return folder


@pytest.fixture
def data(report_data, tmp_path) -> Path:
    return shutil.copytree(report_data, tmp_path / "data")


@pytest.fixture
def outside(tmp_path) -> Path:
    folder = tmp_path / "v"
    folder.mkdir()
    (folder / "thesis.txt").write_text("mine")
    return folder


def link(path: Path, target: Path) -> None:
    """Put a link in the place of a file or folder."""
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    path.symlink_to(target)


@pytest.mark.parametrize(
    ("name", "target"),
    [
        ("report", "v"),
        ("report/objects", "v"),
        ("report/style.css", "v/none"),
        ("report/pages.json", "v/thesis.txt"),
        ("report/.unfinished", "v"),
    ],
)
def test_symbolic_links_in_a_report_are_refused_and_files_outside_are_kept(data, outside, name, target):
    link(data / name, data.parent / target)
    assert f"{data / name} is a symbolic link" in vt("report", data, fails=True)
    assert [path.name for path in outside.iterdir()] == ["thesis.txt"]
    assert (outside / "thesis.txt").read_text() == "mine"
    assert f"{data / name} is a symbolic link" in vt("validate", data, fails=True)


def test_data_directory_may_be_a_symbolic_link(data, tmp_path):
    (tmp_path / "link").symlink_to(data)
    (data / "report" / "objects" / "a.html").unlink()
    vt("report", tmp_path / "link")
    vt("validate", tmp_path / "link")
    assert (data / "report" / "objects" / "a.html").exists()


def with_file(written: bytes, name: str) -> bytes:
    content = json.loads(written)
    content["files"][name] = "0" * 64
    return json.dumps(content).encode()


@pytest.mark.parametrize(
    "damage",
    [
        lambda written: written[: len(written) // 2],
        lambda written: b"\xff\x00",
        lambda written: b"[" * 100_000,
        lambda written: json.dumps({"a": {"key": "0", "category": 3}}).encode(),
        lambda written: with_file(written, "../../v/thesis.txt"),
        lambda written: with_file(written, "/etc/hostname"),
        lambda written: written.replace(b'"areas":[', b'"areas":[NaN,'),
    ],
    ids=["cut", "bytes", "nested", "other", "above", "absolute", "nan"],
)
def test_unusable_list_of_pages_is_refused(report_data, tmp_path, damage: Callable[[bytes], bytes]):
    (tmp_path / "pages.json").write_bytes(damage((report_data / "report" / "pages.json").read_bytes()))
    with pytest.raises(StoreError, match=r"pages.json cannot be used \(.*run `vt-pipeline report` again"):
        read_list(tmp_path / "pages.json", Pages)


def test_list_of_pages_that_names_outside_files_is_written_again_and_they_are_kept(data, outside):
    path = data / "report" / "pages.json"
    path.write_bytes(with_file(path.read_bytes(), "../../v/thesis.txt"))
    assert f"{path} cannot be used" in vt("validate", data, fails=True)
    vt("report", data)
    assert f"{path}: valid" in vt("validate", data)
    assert (outside / "thesis.txt").read_text() == "mine"


def test_missing_or_changed_pages_are_reported_and_written_again(data):
    report = data / "report"
    damages = {
        "objects/a.mesh.js": Path.unlink,
        "index.html": Path.unlink,
        "three.min.js": lambda path: path.write_bytes(b""),
        "figures/touches.svg": lambda path: path.write_text("other"),
    }
    before = {name: (report / name).read_bytes() for name in damages}
    for name, damage in damages.items():
        damage(report / name)
    output = vt("validate", data, fails=True)
    assert all(
        f"{name} {'is missing' if damage is Path.unlink else 'differs from what was written'}" in output for name, damage in damages.items()
    )
    vt("report", data)
    assert {name: (report / name).read_bytes() for name in damages} == before


def test_current_pages_are_kept_and_only_listed_pages_are_removed(data):
    report = data / "report"
    (report / "objects" / "thesis.txt").write_text("mine")
    (report / "objects" / "gone.html").write_text("of an object that is gone")
    (report / "pages.json").write_bytes(with_file((report / "pages.json").read_bytes(), "objects/gone.html"))
    before = {path: path.stat().st_mtime_ns for path in (report / "objects").iterdir() if path.name != "gone.html"}
    vt("report", data)
    assert {path: path.stat().st_mtime_ns for path in (report / "objects").iterdir()} == before
    assert not {"objects/gone.html", "objects/thesis.txt"} & read_list(report / "pages.json", Pages).files.keys()


def test_object_that_moves_to_another_split_gets_another_page(data):
    for path in data.glob("*/0000-of-0001.json"):
        rows = json.loads(path.read_bytes())["rows"]
        path.write_bytes(resealed(path.read_bytes(), rows=[row | {"split": "valid"} for row in rows]))
    page = data / "report" / "objects" / "a.html"
    assert "split valid" not in page.read_text()
    vt("report", data)
    assert "split valid" in page.read_text()


def test_charts_are_shown_beside_the_unet_s_points_only_if_they_are_fitted_to_these(data, tmp_path, monkeypatch):
    (tmp_path / "unet").mkdir()
    publish(data, "models/unet", tmp_path / "unet", "train-unet")
    for name in ("_procedure", "_local_shape", "_sphere"):
        monkeypatch.setattr(figures, name, lambda *_, name=name: name)
    source = ReportSource(data)
    assert figures.draw_figures(source, tmp_path, 1) == ["_procedure", "_sphere"]
    source.collections["charts"].first.record.models["models/unet"] = "0" * 64
    assert len(figures.draw_figures(source, tmp_path, 1)) == 3


def test_grasps_beside_an_evaluation_of_single_images_have_pages(data, tmp_path, monkeypatch):
    (tmp_path / "evaluation").mkdir()
    publish(data, "evaluation-single-image", tmp_path / "evaluation", "evaluate-single-image")
    monkeypatch.setattr("pipeline.tables.evaluation_tables.evaluation_tables", lambda folder: [])
    monkeypatch.setattr("pipeline.contrib.report.results.training_table", lambda *_: Table("Table 4", [], []))
    assert re.search("Table 4.*report: .*no network has been evaluated on the grasps: the report shows", vt("report", data))
    shutil.rmtree(data / "grasps")
    assert "report" not in vt("report", data)


def test_a_model_that_cannot_be_used_ends_a_report_before_its_pages_are_written(data, monkeypatch):
    def refuse(*_: object) -> None:
        raise StoreError("models/unet holds no trained model")

    (data / "report" / "objects" / "a.html").unlink()
    monkeypatch.setattr("pipeline.contrib.report.html_report.draw_figures", refuse)
    monkeypatch.setattr("pipeline.contrib.report.object_page.ObjectPages.write", lambda *_: pytest.fail("a page was written"))
    assert "models/unet holds no trained model" in vt("report", data, fails=True)


def test_missing_facts_of_a_training_are_reported(data, tmp_path):
    (tmp_path / "unet").mkdir()
    publish(data, "models/unet", tmp_path / "unet", "train-unet", {"best": 0})
    assert "unet.json: it lacks facts of a training" in vt("report", data, fails=True)


def test_control_characters_are_shown_as_escape_codes():
    page = _environment().from_string("{% macro cell(x) %}<b>{{ x }}</b>{% endmacro %}{{ cell(text) }}").render(text="<a>\u202eb\x00")
    assert page == "<b>&lt;a&gt;\\u202eb\\x00</b>"


def test_an_object_fills_its_picture_in_the_gallery(report_data):
    """The ball, 0.2 m wide, covers a third of the dataset's images."""
    image = np.asarray(Image.open(report_data / "report" / "objects" / "a.webp").convert("RGB")).astype(int)
    shown = np.abs(image - image[2, 2]).max(axis=-1) > 12
    assert np.ptp(np.flatnonzero(shown.any(axis=1))) > 0.85 * image.shape[0]


def test_numbers_and_their_units_stay_on_one_line():
    page = _environment().from_string("{{ text|units }}").render(text="touch, 3.3 mm & 12 mm², 5 % of 2 m long")
    assert page == "touch, 3.3&nbsp;mm &amp; 12&nbsp;mm², 5&nbsp;% of 2&nbsp;m long"


def test_no_row_of_the_layout_holds_a_single_sensor():
    assert [columns(2 * 2 + sensors) for sensors in (2, 4, 5, 6, 7, 13)] == [6, 8, 9, 10, 6, 9]
