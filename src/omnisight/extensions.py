"""Discovery of extensions, one file of a package each, listed nowhere else; messages of names that do not exist."""

import importlib
import os
import pkgutil
import reprlib
from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TypeVar

Kind = TypeVar("Kind")

# Files of a folder that are compared with the name of a missing one: 20 ms.
MAX_COMPARED_FILES = 1000


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
    return _question({known.lower(): known for known in names}, str(name))


def no_such_file(path: str | os.PathLike[str]) -> str:
    """Return the part of a message about a missing file that follows its name, with the closest name in its folder."""
    path = Path(path)
    try:
        names = os.listdir(path.parent)[:MAX_COMPARED_FILES]
    except OSError:
        names = list[str]()
    return f"no such file or folder{did_you_mean_file(path.name, names)}"


def did_you_mean_file(missing: str, names: Iterable[str]) -> str:
    """Return the part of a message about a missing file which names the closest one; see `did_you_mean`.

    Names are compared without their extensions, which many files share. Of two files with one stem, that with the same
    extension is proposed.
    """
    path = Path(missing)
    known = sorted(names, key=lambda name: Path(name).suffix.lower() == path.suffix.lower())
    return _question({Path(name).stem.lower(): name for name in known}, path.stem)


def file_error(path: str | os.PathLike[str], error: OSError) -> str:
    """Return the part of a message about a file that cannot be read or written that follows its name."""
    return no_such_file(path) if isinstance(error, FileNotFoundError) else error.strerror or str(error)


def _question(names: dict[str, str], name: str) -> str:
    """Return a question with the value of the key (lower case) that is closest to a name; empty if none is close."""
    closest = get_close_matches(name[:80].lower(), names, n=1)
    return f" (did you mean {names[closest[0]]}?)" if closest else ""


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
