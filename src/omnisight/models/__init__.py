"""Camera models: each file of this folder that does not begin with an underscore holds one.

A model is found by its file. Adding a file adds it to the tests, the command line, the formats and the docs.
"""

import importlib
import pkgutil
from functools import cache

from omnisight.models._parameter import Parameter, parameter
from omnisight.models._protocol import CameraModel

__all__ = ["CameraModel", "Parameter", "model_class", "model_names", "parameter"]


@cache
def model_names() -> tuple[str, ...]:
    """Give the names of all camera models, sorted: the names of the files here."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_")))


def model_class(name: str) -> type[CameraModel]:
    """Give the model of that name.

    Raises
    ------
    ValueError
        If there is no such model; the message lists the names.
    """
    if name not in model_names():
        raise ValueError(f"unknown camera model {name!r}; there are: {', '.join(model_names())}")
    module = importlib.import_module(f"{__name__}.{name}")
    return next(
        value
        for value in vars(module).values()
        if isinstance(value, type)
        and issubclass(value, CameraModel)
        and value.__module__ == module.__name__
        and "__dataclass_fields__" in vars(value)  # a profile to inherit from is no model
    )
