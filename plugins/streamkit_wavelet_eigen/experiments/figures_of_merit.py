"""A measured figure: mean, deviation, and over how many."""

from collections.abc import Sequence
from typing import TypedDict

import numpy as np


class Figure(TypedDict):
    """Mean, sample deviation and number of measurements, rounded so that runs compare byte for byte."""

    mean: float
    deviation: float
    n: int


def figure_of(values: Sequence[float], digits: int = 2) -> Figure:
    """The figure of some measurements; one alone has deviation 0."""
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return {
        "mean": round(float(np.mean(values)), digits),
        "deviation": round(deviation, digits),
        "n": len(values),
    }
