"""Tests of learning compute on one thread."""

from tests.one_torch_thread import one_torch_thread  # noqa: F401
