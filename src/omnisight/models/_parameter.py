"""What is known of a camera model's parameter beside its value."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """What is known of a parameter beside its value.

    Attributes
    ----------
    name
        Its name; coefficients of a tuple have one each (a0, a2, a3).
    doc
        What it is, in a few words.
    unit
        "px", or empty for a ratio.
    low, high
        Bounds that every valid camera keeps.
    free
        Whether a calibration estimates it unless told otherwise.
    prior_sigma
        How far from 0 it is expected to be (a standard deviation), known before any image; inf where nothing is.
    """

    name: str
    doc: str
    unit: str = ""
    low: float = -np.inf
    high: float = np.inf
    free: bool = True
    prior_sigma: float = np.inf


def parameter(
    doc: str,
    *,
    unit: str = "",
    low: float = -np.inf,
    high: float = np.inf,
    default: Any = dataclasses.MISSING,
    free: bool = True,
    prior_sigma: float = np.inf,
) -> Any:
    """Declare a parameter of a camera model (a dataclass field): its meaning, unit and bounds."""
    metadata = {"doc": doc, "unit": unit, "low": low, "high": high, "free": free, "prior_sigma": prior_sigma}
    return dataclasses.field(default=default, metadata=metadata)


def finite(value: Any, what: str) -> float:
    """Give the value as a float, or say that it is no finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
        raise ValueError(f"{what} must be a finite number, got {value!r}")
    return float(value)
