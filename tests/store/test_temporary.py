"""Temporary folders are private; the next process removes those of killed ones."""

import os
import signal
import subprocess
import sys
from contextlib import suppress

import pytest

from pipeline.store.temporary import private_folder, temporary_folder

HOLD = """
import time
from pipeline.store.temporary import temporary_folder
with temporary_folder() as folder:
    (folder / "hand.urdf").write_text("a hand")
    print(folder, flush=True)
    time.sleep(600)
"""


@pytest.fixture(autouse=True)
def temporary_root(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))


def test_folder_is_private_and_removed_at_the_end_even_after_an_error():
    with suppress(KeyError), temporary_folder() as folder:
        (folder / "file").write_text("x")
        assert folder.parent == private_folder()
        assert folder.parent.stat().st_mode & 0o777 == 0o700
        raise KeyError
    assert not folder.exists()


def test_next_process_removes_the_folder_of_a_killed_process_and_keeps_that_of_a_live_one():
    with subprocess.Popen([sys.executable, "-c", HOLD], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        folder_of_process = process.stdout.readline().strip()
        with temporary_folder() as first, temporary_folder() as second:
            assert os.path.exists(folder_of_process)
            assert first.exists()
            assert second.exists()
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert os.path.exists(folder_of_process)
    with temporary_folder():
        assert not os.path.exists(folder_of_process)


def test_name_that_another_user_has_taken_is_not_used(tmp_path):
    taken = tmp_path / f"vt-pipeline-{os.getuid()}"
    taken.mkdir()
    taken.chmod(0o777)
    assert private_folder() != taken
    assert private_folder().stat().st_mode & 0o777 == 0o700
