"""One thread of torch per test process: tests run in parallel, one core each, and more threads would only wait for each other."""

from collections.abc import Iterator

import pytest

from pipeline.training.device import torch_threads


@pytest.fixture(scope="session", autouse=True)
def one_torch_thread() -> Iterator[None]:
    with torch_threads(1):
        yield
