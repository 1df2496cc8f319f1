"""A core each, as the other tests of learning."""

from tests.learning.conftest import _one_thread  # noqa: F401
