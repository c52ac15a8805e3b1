"""Finds a browser of the Chromium family; as a program it prints where it is, for `.ci/run`."""

import os
import shutil
import sys
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
)


def find_browser():
    """Give the path of a browser, or None; OMNISIGHT_BROWSER names one, which then must be there."""
    named = os.environ.get("OMNISIGHT_BROWSER")
    if named:
        if not Path(named).is_file():
            raise FileNotFoundError(f"OMNISIGHT_BROWSER is {named}, which is no file")
        return named
    found = (shutil.which(name) for name in NAMES)
    return next(filter(None, found), None) or next((place for place in PLACES if Path(place).is_file()), None)


if __name__ == "__main__":
    browser = find_browser()
    if browser is None:
        sys.exit(f"no browser found: neither {', '.join(NAMES)} on the path nor one in its usual place")
    print(browser)
