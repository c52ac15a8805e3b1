"""Check of the versions of Python and of the required packages."""

import platform
from importlib import metadata

import omnisight
from omnisight.diagnosis.finding import Finding, Level

PRIORITY = 0

REQUIRED = ("numpy", "scipy", "numba", "cyclopts", "rich")


def check() -> Finding:
    """Check that the required packages are installed, and list their versions."""
    found = {name: _version(name) for name in REQUIRED}
    versions = ", ".join(f"{name} {version}" for name, version in found.items() if version)
    figure = f"omnisight {omnisight.__version__}, Python {platform.python_version()}, {versions}; {platform.platform()}"
    missing = [name for name, version in found.items() if not version]
    if missing:
        advice = f"install it again: pip install --force-reinstall omnisight (missing: {', '.join(missing)})"
        return Finding("versions", Level.FAILED, figure, advice)
    return Finding("versions", Level.OK, figure)


def _version(name: str) -> str:
    """Return the version of a distribution; empty if it is not installed."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""
