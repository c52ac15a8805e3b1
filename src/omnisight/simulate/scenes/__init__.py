"""Scenes: each file of this folder that does not begin with an underscore builds one, by its function `scene(seed)`."""

import importlib
import pkgutil
from functools import cache

from omnisight.simulate.scene import Scene


@cache
def scene_names() -> tuple[str, ...]:
    """Give the names of all scenes."""
    return tuple(sorted(found.name for found in pkgutil.iter_modules(__path__) if not found.name.startswith("_")))


@cache
def scene_named(name: str, seed: int = 0) -> Scene:
    """Give a scene by its name; the seed changes what in it is left to chance. It is built once.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    if name not in scene_names():
        raise ValueError(f"there is no scene {name!r}; there are {', '.join(scene_names())}")
    return importlib.import_module(f"{__name__}.{name}").scene(seed)
