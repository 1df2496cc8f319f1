"""Kernels are accurate or raise an error; shapes within the ranges are accepted. `make test-extremes` feeds all shapes."""

import warnings

import pytest

from checks.extremes.kernels import KERNELS, Kernel
from checks.extremes.outcome import feed
from checks.extremes.shapes import SHAPES, Shape

QUICK = {"0.5 m, at 0.6 m", "one sliver 1e8", "grazing 1e-8", "coincident", "1e9 m", "NaN"}
SIZES = [pytest.param(shape, id=shape.name, marks=[] if shape.name in QUICK else [pytest.mark.slow]) for shape in SHAPES]


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("kernel", [pytest.param(kernel, id=kernel.name.split(": ")[1]) for kernel in KERNELS])
def test_kernel_is_accurate_or_refuses_its_input(kernel: Kernel, shape: Shape) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of overflows in what is refused
        assert not feed(kernel, shape).wrong
