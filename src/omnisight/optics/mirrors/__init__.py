"""Mirrors of revolution. Each file of this folder without a leading underscore defines one.

Frame of a mirror: the origin is the vertex; z is the axis and points from the lens into the mirror. The sag z(rho) is
the height of the surface behind the vertex at distance rho from the axis. The side that faces -z reflects.
"""

from omnisight.extensions import class_in, names_in
from omnisight.optics.mirrors._mirror import Mirror

__all__ = ["Mirror", "mirror_class", "mirror_names"]


def mirror_names() -> tuple[str, ...]:
    """Return the names of all mirrors, sorted."""
    return names_in(__name__)


def mirror_class(name: str) -> type[Mirror]:
    """Return the mirror class of a name.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the known names.
    """
    return class_in(__name__, name, Mirror, "mirror")
