"""Inputs of `omnisight reconstruct` and `omnisight map`."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omnisight.pipeline.work_folder import WorkFolder

# Sub-folder of the output with what an interrupted run has computed.
WORK = "work"


@contextmanager
def continuing(work: "WorkFolder") -> Generator[None]:
    """State after Ctrl-C how to continue."""
    try:
        yield
    except KeyboardInterrupt:
        if work.folder is not None and work.folder.is_dir():
            print(f"the same command continues from {work.folder}; delete it to start anew", file=sys.stderr)
        raise


def parse_cameras(values: list[str]) -> str | dict[str, str] | None:
    """Return the file of the only camera, or those of several by name."""
    if len(values) <= 1 and not any("=" in value for value in values):
        return values[0] if values else None
    pairs = [value.partition("=") for value in values]
    if unnamed := [value for value, sign, _ in pairs if not sign]:
        raise ValueError(f"--camera {unnamed[0]}: several cameras need names, such as --camera front={unnamed[0]}")
    return {name: file for name, _, file in pairs}
