"""Paper sizes, by name or as written."""

import re

from omnisight.targets.length import parse_length

PAPERS = {
    "A0": (0.841, 1.189),
    "A1": (0.594, 0.841),
    "A2": (0.420, 0.594),
    "A3": (0.297, 0.420),
    "A4": (0.210, 0.297),
    "A5": (0.148, 0.210),
    "Letter": (0.2159, 0.2794),
    "Legal": (0.2159, 0.3556),
    "Tabloid": (0.2794, 0.4318),
}
"""Width and height in metres, upright."""

SMALLEST, LARGEST = 0.05, 5.0
"""Metres; past 5.08 m a PDF has no page."""


def paper_sizes(paper: str) -> list[tuple[float, float]]:
    """Give the ways to lay that paper: width and height in metres.

    Parameters
    ----------
    paper : str
        A name (A0 to A5, Letter, Legal, Tabloid), which may be laid upright or across, or a size such as 600x400mm,
        which is taken as it is written.

    Raises
    ------
    ValueError
        If it is neither, or has no unit.
    """
    named = {name.lower(): size for name, size in PAPERS.items()}
    if size := named.get(paper.strip().lower()):
        return [size, (size[1], size[0])]
    match = re.fullmatch(r"\s*([0-9.]{1,12})\s*([a-z]*)\s*[x×,]\s*([0-9.]{1,12})\s*([a-z]+)\s*", paper.lower())
    if match is None:
        raise ValueError(
            f"cannot read the paper {paper[:40]!r}: give one of {', '.join(PAPERS)}, or WIDTHxHEIGHT with the unit,"
            " such as 600x400mm"
        )
    width, height = parse_length(match[1] + (match[2] or match[4])), parse_length(match[3] + match[4])
    if not SMALLEST <= min(width, height) <= max(width, height) <= LARGEST:
        raise ValueError(
            f"paper of {millimetres(width, height)} cannot be: sides go from {SMALLEST * 1e3:g} to {LARGEST * 1e3:g} mm"
        )
    return [(width, height)]


def millimetres(width: float, height: float) -> str:
    """Write a size: 297 x 210 mm."""
    return f"{round(width * 1e3, 1):g} x {round(height * 1e3, 1):g} mm"
