"""Tests of the device of networks, and of the memory that they free."""

import ctypes
import sys
from types import SimpleNamespace

import pytest

from pipeline.models.device import KEPT, M_MMAP_THRESHOLD, M_TRIM_THRESHOLD, keep_freed_memory


@pytest.fixture
def library(monkeypatch):
    """Put a C library with nothing in it in place of the system's."""
    library = SimpleNamespace()
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", lambda name: library)
    return library


def test_c_library_without_the_setting_is_left_alone(library):
    keep_freed_memory()
    assert library == SimpleNamespace()


@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_no_library_is_opened_on_other_systems(monkeypatch, platform):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: pytest.fail("a library was opened"))
    keep_freed_memory()


@pytest.mark.parametrize(
    ("answer", "expected"),
    [(1, {M_MMAP_THRESHOLD: KEPT, M_TRIM_THRESHOLD: KEPT}), (0, {M_MMAP_THRESHOLD: KEPT})],
    ids=["accepted", "refused"],
)
def test_freed_memory_is_kept_only_if_large_blocks_can_be(library, answer, expected):
    """Either threshold alone ends glibc's own adjustment of the other: large blocks would be mapped anew each time."""
    thresholds = {}

    def mallopt(parameter, value):
        thresholds[parameter] = value
        return answer

    library.mallopt = mallopt
    keep_freed_memory()
    assert thresholds == expected
