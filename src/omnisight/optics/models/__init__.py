"""Non-central cameras to calibrate: each file of this folder that does not begin with an underscore holds one."""

import importlib
import pkgutil
from functools import cache

from omnisight.optics.ray_model import RayModel

__all__ = ["ray_model_class", "ray_model_names"]


@cache
def ray_model_names() -> tuple[str, ...]:
    """Give the names of all non-central cameras, sorted: the names of the files here."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_")))


def ray_model_class(name: str) -> type[RayModel]:
    """Give the non-central camera of that name.

    Raises
    ------
    ValueError
        If there is no such camera; the message lists the names.
    """
    if name not in ray_model_names():
        raise ValueError(f"unknown non-central camera {name!r}; there are: {', '.join(ray_model_names())}")
    module = importlib.import_module(f"{__name__}.{name}")
    return next(
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, RayModel) and value.__module__ == module.__name__
    )
