"""One section of the calibration report."""

from dataclasses import dataclass

from omnisight.report.html import Markup


@dataclass(frozen=True)
class Guide:
    """How to read a section.

    Attributes
    ----------
    content
        What the figure shows.
    expected
        What a good calibration looks like.
    action
        What to do otherwise.
    """

    content: str
    expected: str
    action: str


@dataclass(frozen=True)
class Section:
    """One section of a report.

    Attributes
    ----------
    id
        Anchor of links.
    title
        Heading, and text of the link in the navigation.
    body
        Figures and tables.
    guide
        How to read them.
    wide
        Whether the body takes the full width, with the guide above it instead of beside it.
    """

    id: str
    title: str
    body: Markup
    guide: Guide
    wide: bool = False
