"""Mirrors of revolution: each file of this folder that does not begin with an underscore holds one.

The frame of a mirror: its origin in the vertex, z along the axis, pointing from the lens into the mirror. The sag
z(rho) says how far behind the vertex the surface lies at the distance rho from the axis. Light is reflected by the side
that looks towards -z.
"""

import importlib
import pkgutil
from functools import cache

from omnisight.optics.mirrors._mirror import Mirror

__all__ = ["Mirror", "mirror_class", "mirror_names"]


@cache
def mirror_names() -> tuple[str, ...]:
    """Give the names of all mirrors, sorted: the names of the files here."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_")))


def mirror_class(name: str) -> type[Mirror]:
    """Give the mirror of that name.

    Raises
    ------
    ValueError
        If there is no such mirror; the message lists the names.
    """
    if name not in mirror_names():
        raise ValueError(f"unknown mirror {name!r}; there are: {', '.join(mirror_names())}")
    module = importlib.import_module(f"{__name__}.{name}")
    return next(
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Mirror) and value.__module__ == module.__name__
    )
