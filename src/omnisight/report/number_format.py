"""Numbers as text, with as many digits as their standard deviation justifies."""

import numpy as np


def format_with_sigma(value: float, sigma: float) -> tuple[str, str]:
    """Format a value and its standard deviation, the latter to two digits, or a dash if it is zero or unknown."""
    if not (np.isfinite(sigma) and sigma > 0):
        return _with_minus_sign(f"{value:.6g}"), "–"
    digits = 1 - int(np.floor(np.log10(sigma)))
    if 0 <= digits <= 7:
        return _with_minus_sign(f"{value:.{digits}f}"), f"{sigma:.{digits}f}"
    power = int(np.floor(np.log10(max(abs(value), sigma))))
    digits = max(0, digits + power)
    scale = 10.0**power
    return _with_minus_sign(f"{value / scale:.{digits}f}e{power}"), f"{sigma / scale:.{digits}f}e{power}"


def _with_minus_sign(text: str) -> str:
    return text.replace("-", "−", 1) if text.startswith("-") else text


def capitalize(sentence: str) -> str:
    """Return a sentence with a capital first letter; the rest is unchanged."""
    return sentence[:1].upper() + sentence[1:]
