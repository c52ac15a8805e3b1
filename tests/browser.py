"""Path of a Chromium-based browser; as a script, print it for `.ci/run`."""

import os
import shutil
import sys
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
PATHS = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
)


def find_browser():
    """Return the path of a browser, or None; the environment variable OMNISIGHT_BROWSER overrides the search."""
    named = os.environ.get("OMNISIGHT_BROWSER")
    if named:
        if not Path(named).is_file():
            raise FileNotFoundError(f"OMNISIGHT_BROWSER is {named}, which is not a file")
        return named
    commands = (shutil.which(name) for name in NAMES)
    return next(filter(None, commands), None) or next((path for path in PATHS if Path(path).is_file()), None)


if __name__ == "__main__":
    browser = find_browser()
    if browser is None:
        sys.exit(f"no browser found: install one of {', '.join(NAMES)}, or set OMNISIGHT_BROWSER to its path")
    print(browser)
