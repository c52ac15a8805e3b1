"""Parse and format lengths with their unit."""

import re

import numpy as np

UNITS_PER_METRE = {"mm": 1000, "cm": 100, "m": 1, "in": 1 / 0.0254, "um": 1e6}


def parse_length(text: str, name: str = "") -> float:
    """Parse a length with its unit, such as `32.5mm`, to metres.

    Raises
    ------
    ValueError
        Without a unit, or if not positive. The message starts with the name of the option or field, such as "--square".
    """
    start = f"{name}: " if name else ""
    if not isinstance(text, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ValueError(f"{start}expected a length with its unit, such as '32.5mm', got {text!r}")
    match = re.fullmatch(r"\s*(-?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*([a-zA-Zµμ\"]*)\s*", text)
    units = ", ".join(UNITS_PER_METRE)
    if match is None:
        raise ValueError(
            f"{start}cannot read the length {text!r}: expected a number with its unit ({units}), such as 32.5mm"
        )
    number, unit = match[1], re.sub("[µμ]", "u", match[2].lower())
    if not float(number) > 0:
        raise ValueError(f"{start}the length {text.strip()!r} must be positive")
    if not unit:
        raise ValueError(f"{start}the length {text.strip()!r} has no unit: write {number}mm or {number}m ({units})")
    if unit not in UNITS_PER_METRE:
        raise ValueError(f"{start}the length {text.strip()!r} has an unknown unit {match[2]!r}: use one of {units}")
    metres = float(number) / UNITS_PER_METRE[unit]
    if not 0 < metres < np.inf:
        raise ValueError(f"{start}the length {text.strip()!r} must be positive and finite")
    return metres


def format_length(metres: float) -> str:
    """Format a length in millimetres, with the unit."""
    return f"{metres * 1e3:.10g}mm"
