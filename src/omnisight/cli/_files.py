"""Files that a command writes, and what they say of their making."""

import tempfile
from pathlib import Path


def made_now() -> dict[str, str]:
    """Give what the provenance of a camera begins with: the program and the date."""
    import datetime

    import omnisight

    date = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    return {"tool": f"omnisight {omnisight.__version__}", "date": date}


def must_be_writable(output: Path) -> None:
    """Refuse, before any work, a file that could not be written after it."""
    if output.is_dir():
        raise ValueError(f"{output}: is a folder; name a file in it, such as {output / 'camera.json'}")
    if not output.parent.is_dir():
        raise ValueError(f"{output}: there is no folder {output.parent}; make it first")
    try:
        tempfile.TemporaryFile(dir=output.parent).close()
    except OSError as error:
        raise ValueError(f"{output}: cannot be written: {error.strerror} ({output.parent})") from error
