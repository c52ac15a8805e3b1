"""Verdict: whether a calibration can be used, and what to do if not."""

from dataclasses import dataclass
from typing import Self

from omnisight.display import Displayed
from omnisight.quality.checks import all_checks
from omnisight.quality.evidence import Check, Evidence, Level


@dataclass(frozen=True)
class Verdict(Displayed):
    """Whether a calibration can be used.

    Attributes
    ----------
    level
        The worst level of all checks.
    checks
        The results of all checks that apply.
    """

    level: Level
    checks: tuple[Check, ...]

    @classmethod
    def of(cls, evidence: Evidence) -> Self:
        """Run all checks."""
        checks = tuple(result for check in all_checks() if (result := check(evidence)) is not None)
        return cls(max(check.level for check in checks), checks)

    @property
    def reasons(self) -> tuple[str, ...]:
        """One sentence per failed check, with what to do; the worst first."""
        failed = sorted((check for check in self.checks if check.level > Level.GOOD), key=lambda check: -check.level)
        return tuple(check.sentence for check in failed)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences of checks that passed with a remark."""
        return tuple(check.sentence for check in self.checks if check.sentence and check.level == Level.GOOD)

    def __str__(self) -> str:
        return str(self.level)
