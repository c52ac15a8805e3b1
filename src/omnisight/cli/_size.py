"""Sizes and ranges as people write them."""


def parse_size(text: str, what: str = "--size") -> tuple[int, int]:
    """Read "1280x720", or "800" for a square."""
    parts = text.lower().replace(",", "x").split("x")
    try:
        numbers = [int(p) for p in parts]
    except ValueError:
        numbers = []
    if len(numbers) == 1:
        numbers *= 2
    if len(numbers) != 2 or min(numbers) < 1:
        raise ValueError(f"{what} must be WIDTHxHEIGHT in px, such as 1280x720, got {text!r}")
    return numbers[0], numbers[1]


def parse_range(text: str, what: str) -> tuple[float, float]:
    """Read "-40,30" or "-40:30"."""
    parts = text.replace(":", ",").split(",")
    try:
        low, high = (float(p) for p in parts)
    except ValueError:
        raise ValueError(f"{what} must be two numbers in degrees, such as {what} -40:30, got {text!r}") from None
    return low, high
