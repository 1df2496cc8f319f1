"""The next batch is read while the network learns from the current one."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
import torch

from pipeline.errors import StoreError
from pipeline.training.loop import read_ahead, read_metrics
from tests.training.regression import Batch, Regression, fit


def test_reading_and_computing_overlap() -> None:
    def slow(part: int) -> int:
        time.sleep(0.1)  # a remote store
        return 10 * part

    began, found = time.monotonic(), []
    for part, content in read_ahead(slow, range(8)):
        found.append((part, content()))
        time.sleep(0.1)
    assert found == [(part, 10 * part) for part in range(8)]
    assert time.monotonic() - began < 1.4  # one after the other: 1.6 s


def test_one_part_is_read_ahead_and_errors_are_raised_in_order() -> None:
    read: list[int] = []

    def note(part: int) -> int:
        read.append(part)
        if part == 2:
            raise StoreError("gone")
        return part

    parts = read_ahead(note, range(9))
    for expected in range(2):
        assert next(parts)[1]() == expected
    content = next(parts)[1]
    with pytest.raises(StoreError, match="gone"):
        content()
    parts.close()  # type: ignore[attr-defined]
    assert read in ([0, 1, 2], [0, 1, 2, 3])


def test_read_ahead_of_no_parts_is_empty() -> None:
    assert not list(read_ahead(int, []))


class Waiting(Regression):
    """Learns from a batch when the reading of the next one has begun."""

    def __init__(self) -> None:
        super().__init__(plain=True)
        self.begun, self.threads = threading.Semaphore(0), set[str]()

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        self.threads.add(threading.current_thread().name)
        self.begun.release()
        return super().read(items, generators)

    def loss(self, network: torch.nn.Module, batch: Batch) -> torch.Tensor:
        last = self.steps % 6 == 5  # of 6 batches of an epoch
        assert self.begun.acquire(timeout=20)
        if not last:
            assert self.begun.acquire(timeout=20)
            self.begun.release()
        return super().loss(network, batch)


def test_training_with_read_ahead_has_the_losses_of_one_without(tmp_path: Path) -> None:
    waiting = Waiting()
    fit(waiting, tmp_path / "ahead", epochs=2)
    fit(Regression(plain=True), tmp_path / "plain", epochs=2)
    assert threading.main_thread().name not in waiting.threads
    assert read_metrics(tmp_path / "ahead") == read_metrics(tmp_path / "plain")


class Unreadable(Regression):
    """An item's chunk is damaged."""

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        if 17 in items:
            raise StoreError("readings of point-17 cannot be read")
        return super().read(items, generators)


def test_read_error_ends_the_training_with_its_message(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="readings of point-17 cannot be read"):
        fit(Unreadable(), tmp_path)
