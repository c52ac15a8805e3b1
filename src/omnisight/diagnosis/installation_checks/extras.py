"""Check of the optional packages."""

import re
from importlib import metadata, util

from omnisight.diagnosis.finding import Finding, Level

PRIORITY = 50

# Extras of the development of omnisight itself.
INTERNAL = ("dev", "docs")


def check() -> Finding:
    """List which extras of omnisight are installed; none is needed."""
    extras = dict[str, list[str]]()
    for requirement in metadata.requires("omnisight") or ():
        if found := re.match(r"([\w.-]+).*extra\s*==\s*['\"]([\w-]+)['\"]", requirement):
            extras.setdefault(found[2], []).append(found[1])
    parts = [
        f"{extra}: {'yes' if all(map(_is_installed, names)) else 'no'}"
        for extra, names in extras.items()
        if extra not in INTERNAL
    ]
    missing = [part.split(":")[0] for part in parts if part.endswith("no")]
    advice = f'optional: pip install "omnisight[{",".join(missing)}]"' if missing else ""
    return Finding("extras", Level.OK, ", ".join(parts) or "none declared", advice)


def _is_installed(name: str) -> bool:
    """Return whether a distribution is installed."""
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return util.find_spec(name.replace("-", "_")) is not None
    return True
