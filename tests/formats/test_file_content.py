"""Only regular files up to a size are read; text begins after its byte-order mark, and content of another kind is named."""

import os
import stat
from pathlib import Path

import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import foreign_content, is_pointer, is_pointer_file, read_file, read_text, without_mark


def test_sockets_devices_folders_and_large_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(bytes(11))
    os.mknod(tmp_path / "socket", stat.S_IFSOCK | 0o600)
    refused = {
        tmp_path / "large": "has 11 bytes; 10 are the most",
        tmp_path / "socket": "not a regular file",
        Path("/dev/null"): "not a regular file",
        tmp_path: "not a regular file",
        tmp_path / "a\0b": "no file has such a name",
        tmp_path / "absent": r"cannot be read \(No such file",
    }
    for path, words in refused.items():
        with pytest.raises(InvalidInput, match=words):
            read_file(path, 10)
    assert read_file(tmp_path / "large", 11) == bytes(11)


POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:" + 64 * "5" + "\nsize 70000\n"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (POINTER, True),
        (POINTER.replace("\n", "\r\n"), True),
        (POINTER.replace("git-lfs", "hawser"), True),
        ("version http://git-media.io/v/2\noid 5\n", True),
        (POINTER + 1000 * "x", False),
        ("# " + POINTER, False),
        ("", False),
    ],
)
def test_pointer_of_git_lfs_is_recognised_by_its_beginning_and_size(tmp_path: Path, content: str, expected: bool) -> None:
    (tmp_path / "a").write_bytes(content.encode())
    assert is_pointer(content.encode()) == is_pointer_file(tmp_path / "a") == expected
    assert not is_pointer_file(tmp_path)
    if expected:
        with pytest.raises(InvalidInput, match=r"a is a Git LFS pointer; run `git lfs pull`$"):
            read_file(tmp_path / "a", 2000)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32", "utf-16-le", "utf-16-be", "utf-32-le", "utf-32-be"])
def test_text_is_read_in_the_encoding_of_its_mark(tmp_path: Path, encoding: str) -> None:
    mark = "\ufeff" if encoding[-3:] in ("-le", "-be") else ""
    (tmp_path / "a").write_bytes((mark + "Größe 5 mm").encode(encoding))
    assert read_text(tmp_path / "a", 100) == "Größe 5 mm"


def test_text_in_another_encoding_than_its_mark_says_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"\xff\xfeabc")
    with pytest.raises(InvalidInput, match="a begins like text in UTF-16-LE and is not; save it as UTF-8"):
        read_text(tmp_path / "a", 100)
    (tmp_path / "a").write_bytes("Größe".encode("latin-1"))
    with pytest.raises(InvalidInput, match="a is not text in UTF-8"):
        read_text(tmp_path / "a", 100)


def test_encoding_that_xml_declares_leaves_with_the_mark() -> None:
    xml = '<?xml version="1.0" encoding="utf-16" standalone="yes"?><a/>'
    assert without_mark("a", xml.encode("utf-16")) == b'<?xml version="1.0" standalone="yes"?><a/>'
    assert without_mark("a", xml.encode()) == xml.encode()


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (b"", "an empty file"),
        (POINTER.encode(), "a Git LFS pointer; run `git lfs pull`"),
        (b"/annex/objects/SHA256E-s5--5\n", "a git-annex pointer; run `git annex get`"),
        (b"\n<!-- a --><!-- b -->\n<!DOCTYPE html>", "a web page"),
        (b"404: Not Found", "an error message of a server"),
        (b'<?xml version="1.0"?>\n<Error><Code>AccessDenied</Code></Error>', "an error message of a server"),
        (b'<?xml version="1.0"?>\n<html/>', "a web page"),
        (b'<?xml version="1.0"?><svg/>', "an SVG drawing"),
        (b"PK\x03\x04", "a ZIP archive"),
        (b"\x1f\x8b\x08", "compressed"),
        (b"a" + bytes(256) + b"ustar", "compressed, or an archive"),
        (b"\x76\x2f\x31\x01", "an OpenEXR image"),
        (b"ISO-10303-21;", "a STEP file"),
    ],
)
def test_foreign_content_is_named(content: bytes, name: str) -> None:
    assert (foreign_content(content) or "").startswith(name)


@pytest.mark.parametrize(
    "content", [b"v 0 0 0\n", b"<COLLADA/>", b"<?xml version='1.0'?><robot/>", b"solid <html>", b"<!-- " * 500, bytes(99)]
)
def test_other_content_is_not_taken_for_foreign(content: bytes) -> None:
    assert foreign_content(content) is None
