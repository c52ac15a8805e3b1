"""Metadata of the parameters of camera models."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """Metadata of a parameter.

    Attributes
    ----------
    name
        Name; each coefficient of a tuple has its own (a0, a2, a3).
    doc
        Short description.
    unit
        "px", or empty for a ratio.
    low, high
        Bounds of valid cameras.
    free
        Whether a calibration estimates it by default.
    prior_sigma
        Standard deviation of a zero-mean Gaussian prior, part of every cost; inf if there is none.
    start_zero
        Whether a well-built camera has next to nothing of it (decentring): a calibration starts from 0.
    truncated_start
        Whether it is a term of a series whose terms nearly compensate each other: a calibration also starts from the
        series without this term and those after it.
    start_scale
        Scale of the Cauchy distribution about a fitted value from which starts of a calibration are drawn; 0 for none.
    start_range
        Interval from which starts of a calibration are drawn uniformly instead.
    """

    name: str
    doc: str
    unit: str = ""
    low: float = -np.inf
    high: float = np.inf
    free: bool = True
    prior_sigma: float = np.inf
    start_zero: bool = False
    truncated_start: bool = False
    start_scale: float = 0.0
    start_range: tuple[float, float] | None = None


def parameter(doc: str, *, default: Any = dataclasses.MISSING, **known: Any) -> Any:
    """Declare a parameter of a camera model (a dataclass field): its meaning, and the other fields of `Parameter`."""
    Parameter("", doc, **known)  # raises TypeError for an unknown field
    return dataclasses.field(default=default, metadata={"doc": doc, **known})


def finite(value: Any, what: str) -> float:
    """Return the value as a float; raise ValueError if it is not a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
        raise ValueError(f"{what} must be a finite number, got {value!r}")
    return float(value)
