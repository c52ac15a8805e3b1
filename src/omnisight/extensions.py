"""Discovery of extensions: one file of a package each, listed nowhere else."""

import importlib
import pkgutil
import reprlib
from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache
from types import ModuleType
from typing import TypeVar

Kind = TypeVar("Kind")


@cache
def names_in(package: str) -> tuple[str, ...]:
    """Return the sorted names of the files of a package that do not begin with an underscore."""
    folder = importlib.import_module(package).__path__
    return tuple(sorted(module.name for module in pkgutil.iter_modules(folder) if not module.name.startswith("_")))


def module_in(package: str, name: str, what: str) -> ModuleType:
    """Import a file of a package.

    Raises
    ------
    ValueError
        If there is no such file; the message lists the available names.
    """
    if name not in names_in(package):
        raise ValueError(unknown_name(what, name, names_in(package)))
    return importlib.import_module(f"{package}.{name}")


def unknown_name(what: str, name: object, names: Iterable[str]) -> str:
    """Return the message that there is no `what` of a name, with the closest name and all of them."""
    known = list(names)
    return f"unknown {what} {reprlib.repr(name)}{did_you_mean(name, known)}; there are: {', '.join(known)}"


def did_you_mean(name: object, names: Iterable[str]) -> str:
    """Return the part of a message about a name that does not exist which names the closest one; empty if none is."""
    known = {known.lower(): known for known in names}
    closest = get_close_matches(str(name)[:80].lower(), known, n=1)
    return f" (did you mean {known[closest[0]]}?)" if closest else ""


def class_in(package: str, name: str, kind: type[Kind], what: str) -> type[Kind]:
    """Return the dataclass of a kind that is defined in a file of a package; see `module_in` for errors."""
    module = module_in(package, name, what)
    return next(
        value
        for value in vars(module).values()
        if isinstance(value, type)
        and issubclass(value, kind)
        and value.__module__ == module.__name__
        and "__dataclass_fields__" in vars(value)  # base classes are not dataclasses
    )
