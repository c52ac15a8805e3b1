"""Checks of the installation: each file of this folder that does not begin with an underscore holds one.

A check is a function `check() -> Finding` and a `PRIORITY`, by which findings are listed. Adding a file adds the check.
"""

from collections.abc import Callable
from functools import cache

from omnisight.diagnosis.finding import Finding
from omnisight.extensions import module_in, names_in


@cache
def all_checks() -> tuple[Callable[[], Finding], ...]:
    """Return all checks by ascending priority."""
    modules = [module_in(__name__, name, "check") for name in names_in(__name__)]
    return tuple(module.check for module in sorted(modules, key=lambda module: module.PRIORITY))
