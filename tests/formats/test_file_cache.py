"""Values computed from files are kept between runs, until a file changes."""

import os
from pathlib import Path

import pytest

from pipeline.formats import file_cache
from pipeline.formats.file_cache import FileCache, stamps_of


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "source"
    path.write_text("old")
    os.utime(path, (0, 0))
    return path


def test_value_is_kept_until_its_file_or_the_code_changes(tmp_path: Path, source: Path) -> None:
    """Values are whatever can be pickled."""
    code, path = tmp_path / "code.py", tmp_path / "new" / "kept.pickle"
    code.touch()
    kept = FileCache(path, stamps_of([code]), limit=2)
    assert kept.find("name") is None
    kept.keep("name", {"value": (1, 2.0)}, [source])
    kept.save()
    assert FileCache(path, stamps_of([code]), limit=2).find("name") == {"value": (1, 2.0)}
    code.write_text("another")
    assert FileCache(path, stamps_of([code]), limit=2).find("name") is None
    source.write_text("new")
    assert kept.find("name") is None


def test_value_is_not_kept_if_its_file_was_written_since_the_cache_was_opened(tmp_path: Path, source: Path) -> None:
    """It may be of what the file held before."""
    kept = FileCache(tmp_path / "kept.pickle", None, limit=2)
    kept.opened = source.stat().st_ctime_ns  # as if the file had been written just then
    kept.keep("name", "value", [source])
    assert kept.find("name") is None
    kept.keep("name", "value", [tmp_path / "missing"])
    assert kept.find("name") is None


def test_oldest_and_large_values_are_not_kept(tmp_path: Path, source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file stays small."""
    monkeypatch.setattr(file_cache, "MAX_BYTES", 100)
    kept = FileCache(tmp_path / "kept.pickle", None, limit=2)
    for name in ("first", "second", "third"):
        kept.keep(name, name, [source])
    kept.keep("large", bytes(101), [source])
    assert [kept.find(name) for name in ("first", "second", "third", "large")] == [None, "second", "third", None]


@pytest.mark.parametrize("content", [b"", b"{}", b"\x80\x05.", b"cnone\nmissing\n."])
def test_damaged_file_holds_nothing_and_is_written_anew(tmp_path: Path, source: Path, content: bytes) -> None:
    """As after a crash, or from another version."""
    path = tmp_path / "kept.pickle"
    path.write_bytes(content)
    kept = FileCache(path, None, limit=2)
    assert kept.find("name") is None
    kept.keep("name", "value", [source])
    kept.save()
    assert FileCache(path, None, limit=2).find("name") == "value"


def test_cache_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path, source: Path) -> None:
    """As on a full disk, or a read-only one."""
    path = tmp_path / "kept.pickle"
    path.mkdir()  # no file can replace it
    kept = FileCache(path, None, limit=2)
    kept.keep("name", "value", [source])
    kept.save()
    assert kept.find("name") == "value"
    assert sorted(tmp_path.iterdir()) == [path, source]
