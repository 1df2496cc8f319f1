"""`vt-pipeline doctor`: what is installed, and what is broken."""

import sys

import torch

from pipeline.checks.doctor import _device
from tests.command_line import vt


def test_doctor_succeeds_in_a_complete_environment():
    assert "headless rendering" in vt("doctor")


class Broken:
    """Finds torch, whose libraries cannot be loaded."""

    def find_spec(self, name: str, *_: object) -> None:
        if name == "torch":
            raise OSError("libcudart.so: cannot open shared object file")
        return None


def test_doctor_continues_if_torch_is_broken(monkeypatch):
    assert _device() != "none, torch cannot be imported"
    monkeypatch.delitem(sys.modules, torch.__name__)
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    assert _device() == "none, torch cannot be imported"
