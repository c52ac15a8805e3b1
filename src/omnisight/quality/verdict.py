"""Whether a calibration can be used, and what to do where it cannot."""

from dataclasses import dataclass
from typing import Self

from omnisight.quality.checks import CHECKS
from omnisight.quality.evidence import Check, Evidence, Level


@dataclass(frozen=True)
class Verdict:
    """Whether a calibration can be used.

    Attributes
    ----------
    level
        The worst of the checks.
    checks
        Everything that was looked at.
    """

    level: Level
    checks: tuple[Check, ...]

    @classmethod
    def of(cls, evidence: Evidence) -> Self:
        """Judge a calibration by every check that there is evidence for."""
        checks = tuple(found for check in CHECKS if (found := check(evidence)) is not None)
        return cls(max(check.level for check in checks), checks)

    @property
    def reasons(self) -> tuple[str, ...]:
        """One sentence for each failed check, with what to do; the worst first."""
        failed = sorted((check for check in self.checks if check.level > Level.GOOD), key=lambda check: -check.level)
        return tuple(check.sentence for check in failed)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is worth knowing although nothing failed, a sentence each."""
        return tuple(check.sentence for check in self.checks if check.sentence and check.level == Level.GOOD)

    def __str__(self) -> str:
        return str(self.level)
