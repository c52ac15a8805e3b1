"""Mirrors of revolution: each file of this folder that does not begin with an underscore holds one.

The frame of a mirror: its origin in the vertex, z along the axis, pointing from the lens into the mirror. The sag
z(rho) says how far behind the vertex the surface lies at the distance rho from the axis. Light is reflected by the side
that looks towards -z.
"""

from omnisight.extensions import class_in, names_in
from omnisight.optics.mirrors._mirror import Mirror

__all__ = ["Mirror", "mirror_class", "mirror_names"]


def mirror_names() -> tuple[str, ...]:
    """Give the names of all mirrors, sorted: the names of the files here."""
    return names_in(__name__)


def mirror_class(name: str) -> type[Mirror]:
    """Give the mirror of that name.

    Raises
    ------
    ValueError
        If there is no such mirror; the message lists the names.
    """
    return class_in(__name__, name, Mirror, "mirror")
