"""Scenes: each file of this folder that does not begin with an underscore builds one, by its function `scene(seed)`."""

from functools import cache

from omnisight.extensions import module_in, names_in
from omnisight.simulation.scene import Scene


def scene_names() -> tuple[str, ...]:
    """Return the names of all scenes."""
    return names_in(__name__)


@cache
def scene_named(name: str, seed: int = 0) -> Scene:
    """Return a scene by its name; the seed changes what in it is left to chance. It is built once.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    return module_in(__name__, name, "scene").scene(seed)
