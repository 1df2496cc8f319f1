"""Where networks run, and on how many threads."""

from __future__ import annotations

import pytest
import torch

from pipeline.errors import StageError
from pipeline.training.device import device_of, torch_threads


def test_threads_are_as_before_even_after_an_error() -> None:
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


def test_a_device_that_is_not_there_is_named_with_the_way_out() -> None:
    with pytest.raises(StageError, match=r"accelerator abacus cannot be used .* take auto or cpu"):
        device_of("abacus")
