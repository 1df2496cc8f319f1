"""Outcomes of kernels: an error, or a refusal with a message."""

from dataclasses import dataclass

from checks.extremes.kernels import Kernel
from checks.extremes.shapes import Shape


@dataclass(frozen=True)
class Outcome:
    """What came of feeding a shape to a kernel.

    Attributes
    ----------
    text
        The error, or `refused`.
    wrong
        What is wrong with that; empty where nothing is.
    """

    text: str
    wrong: str = ""


def feed(kernel: Kernel, shape: Shape) -> Outcome:
    """Feed a shape to a kernel."""
    try:
        error = kernel.error(shape)
    except ValueError as refusal:
        words = len(str(refusal).split()) > 3
        return Outcome("refused", "" if shape.beyond and words else f"refused: {refusal}")
    bound = kernel.bound_for(shape)
    wider = f" ({bound:.0e})" if bound != kernel.bound else ""
    return Outcome(
        f"{error:.0e}{wider}" if error else "0", "" if error <= bound else f"the error is {error:.2g}; at most {bound:.2g} is promised"
    )
