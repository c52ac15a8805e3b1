"""Check of the programs and packages that write clips."""

import shutil
import subprocess
from importlib import metadata

from omnisight.diagnosis.finding import Finding, Level

PRIORITY = 60

TIMEOUT_S = 10.0


def check() -> Finding:
    """Check which of FFmpeg and PyAV are installed."""
    program, pyav = _ffmpeg(), _pyav()
    figure = f"ffmpeg: {program or 'not found'}; PyAV: {pyav or 'not installed'}"
    advice = "" if program or pyav else "clips can be read, not written: pip install av, or install ffmpeg"
    return Finding("video", Level.OK, figure, advice)


def _ffmpeg() -> str:
    """Return the version of the program; empty if it is not found."""
    path = shutil.which("ffmpeg")
    if path is None:
        return ""
    try:
        done = subprocess.run([path, "-version"], capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    words = done.stdout.split()
    return words[2] if words[:2] == ["ffmpeg", "version"] else path


def _pyav() -> str:
    """Return the version of PyAV; empty if it is not installed."""
    try:
        return metadata.version("av")
    except metadata.PackageNotFoundError:
        return ""
