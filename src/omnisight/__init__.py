"""Calibrate fisheye, mirror and other omnidirectional cameras, and turn their images into views.

The public names are listed in `__init__.pyi`. Each is imported at its first use, which lets a new process start fast.
"""

import importlib as _importlib
import pathlib as _pathlib
import re as _re

__version__ = "0.1.0"

_STUB = _pathlib.Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_MODULES = {name: module for module, name in _re.findall(r"^from (\S+) import \w+ as (\w+)$", _STUB, _re.MULTILINE)}

__all__ = sorted(_MODULES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    """Import a public name at its first use."""
    if name not in _MODULES:
        raise AttributeError(f"module 'omnisight' has no attribute {name!r}")
    return getattr(_importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    """List the public names, for `dir` and tab completion."""
    return [*__all__, "__version__"]
