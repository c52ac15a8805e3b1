"""Results of checks."""

from dataclasses import dataclass
from enum import IntEnum

from omnisight.display import Displayed


class Level(IntEnum):
    """What a finding means for the use of a recording or of the installation."""

    OK = 0
    UNKNOWN = 1
    WARNING = 2
    FAILED = 3

    def __str__(self) -> str:
        return self.name.lower()


@dataclass(frozen=True)
class Finding(Displayed):
    """The result of a check.

    Attributes
    ----------
    name
        What was checked.
    level
        Whether it is all right.
    figure
        What was measured, in one line.
    advice
        What to do; empty if nothing is needed.
    """

    name: str
    level: Level
    figure: str
    advice: str = ""
