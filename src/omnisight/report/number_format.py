"""Numbers as text, with as many digits as they are known to."""

import numpy as np


def with_sigma(value: float, sigma: float) -> tuple[str, str]:
    """Write a value and its standard deviation to two digits of the latter; a dash where that is nought or unknown."""
    if not (np.isfinite(sigma) and sigma > 0):
        return _signed(f"{value:.6g}"), "–"
    digits = 1 - int(np.floor(np.log10(sigma)))
    if 0 <= digits <= 7:
        return _signed(f"{value:.{digits}f}"), f"{sigma:.{digits}f}"
    power = int(np.floor(np.log10(max(abs(value), sigma))))
    digits = max(0, digits + power)
    scale = 10.0**power
    return _signed(f"{value / scale:.{digits}f}e{power}"), f"{sigma / scale:.{digits}f}e{power}"


def _signed(text: str) -> str:
    return text.replace("-", "−", 1) if text.startswith("-") else text
