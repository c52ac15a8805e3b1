"""Paper sizes, by name or in numbers."""

import os
import re

from omnisight.extensions import did_you_mean
from omnisight.targets.length import parse_length

# Width and height in metres, upright.
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

# The default paper, and the larger ones that a message proposes, smallest first.
ISO_SERIES = ("A4", "A3", "A2", "A1", "A0")
LETTER_SERIES = ("Letter", "Tabloid", "A2", "A1", "A0")
# Territories that use US Letter, by the Unicode CLDR.
LETTER_TERRITORIES = {"BZ", "CA", "CL", "CO", "CR", "GT", "MX", "NI", "PA", "PH", "PR", "SV", "US", "VE"}

# Sides in metres: a PDF page ends at 5.08 m.
MIN_SIDE, MAX_SIDE = 0.05, 5.0


def paper_sizes(paper: str) -> list[tuple[float, float]]:
    """Return the orientations of a paper: (width, height) in metres each.

    Parameters
    ----------
    paper : str
        A name (A0 to A5, Letter, Legal, Tabloid), with both orientations, or a size such as 600x400mm, with one.

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
            f"cannot read the paper {paper[:40]!r}{did_you_mean(paper, PAPERS)}: use one of {', '.join(PAPERS)}, or"
            " WIDTHxHEIGHT with the unit, such as 600x400mm"
        )
    width, height = parse_length(match[1] + (match[2] or match[4])), parse_length(match[3] + match[4])
    if not MIN_SIDE <= min(width, height) <= max(width, height) <= MAX_SIDE:
        raise ValueError(
            f"paper of {millimetres(width, height)} is not possible: sides range from {MIN_SIDE * 1e3:g} to"
            f" {MAX_SIDE * 1e3:g} mm"
        )
    return [(width, height)]


def local_series() -> tuple[str, ...]:
    """Return the papers of the user's territory, smallest first: US Letter or A4, by the POSIX locale."""
    locale = next((value for name in ("LC_ALL", "LC_PAPER", "LANG") if (value := os.environ.get(name))), "")
    territory = re.match(r"[a-z]{2,3}_([A-Z]{2})\b", locale)
    return LETTER_SERIES if territory is not None and territory[1] in LETTER_TERRITORIES else ISO_SERIES


def default_paper() -> str:
    """Return the paper of a board for which none is specified: A4, or Letter where that is in use."""
    return local_series()[0]


def millimetres(width: float, height: float) -> str:
    """Format a size: 297 x 210 mm."""
    return f"{round(width * 1e3, 1):g} x {round(height * 1e3, 1):g} mm"
