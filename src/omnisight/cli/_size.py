"""Parsing of sizes and ranges in command-line options."""


def parse_size(text: str, option: str = "--size") -> tuple[int, int]:
    """Parse "1280x720", or "800" for a square."""
    parts = text.lower().replace(",", "x").split("x")
    try:
        sides = [int(part) for part in parts]
    except ValueError:
        sides = []
    if len(sides) == 1:
        sides *= 2
    if len(sides) != 2 or min(sides) < 1:
        raise ValueError(f"{option} must be WIDTHxHEIGHT in px, such as 1280x720, got {text!r}")
    return sides[0], sides[1]


def parse_range(text: str, option: str) -> tuple[float, float]:
    """Parse "-40:30" or "-40,30"."""
    try:
        low, high = (float(part) for part in text.replace(":", ",").split(","))
    except ValueError:
        raise ValueError(f"{option} must be two numbers in degrees, such as {option} -40:30, got {text!r}") from None
    return low, high
