"""Quality checks: each file of this folder that does not begin with an underscore holds one.

A check is a function `check(evidence) -> Check | None` (None if it does not apply) and a `PRIORITY`: reasons of the
same level are listed by ascending priority, causes before their effects. Adding a file adds the check.

Unless stated otherwise, limits are from `python -m benchmarks verdict`, which calibrates known cameras; the table is in
docs/guide/calibrate.md. Limits in px are for an image 1000 px wide and scale with the width.
"""

from collections.abc import Callable
from functools import cache

from omnisight.extensions import module_in, names_in
from omnisight.quality.evidence import Check, Evidence


@cache
def all_checks() -> tuple[Callable[[Evidence], Check | None], ...]:
    """Return all checks by ascending priority."""
    modules = [module_in(__name__, name, "check") for name in names_in(__name__)]
    return tuple(module.check for module in sorted(modules, key=lambda module: module.PRIORITY))
