"""Scenes. Each file of this folder without a leading underscore builds one by its function `scene(seed)`."""

from functools import cache

from omnisight.extensions import module_in, names_in
from omnisight.simulation.scene import Scene


def scene_names() -> tuple[str, ...]:
    """Return the names of all scenes."""
    return names_in(__name__)


@cache
def scene_named(name: str, seed: int = 0) -> Scene:
    """Return a scene by name, built once; the seed changes its random parts.

    Raises
    ------
    ValueError
        If the name is unknown.
    """
    return module_in(__name__, name, "scene").scene(seed)
