"""Where networks run, and on how many threads."""

from __future__ import annotations

import pytest
import torch

from pipeline.errors import StageError
from pipeline.training.device import device_of, torch_threads


def test_number_of_threads_is_restored_even_after_an_error() -> None:
    before = torch.get_num_threads()
    inside = []

    def fail() -> None:
        with torch_threads(before + 1):
            inside.append(torch.get_num_threads())
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert inside == [before + 1]
    assert torch.get_num_threads() == before


def test_unavailable_device_is_named_with_the_remedy() -> None:
    with pytest.raises(StageError, match=r"accelerator abacus cannot be used .* take auto or cpu"):
        device_of("abacus")
