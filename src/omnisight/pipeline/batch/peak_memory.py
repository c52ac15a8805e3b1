"""Memory of the process."""

import sys
from pathlib import Path


def peak_memory_bytes() -> int | None:
    """Return the largest resident memory of the process so far; None if the system does not report it.

    Processes that it started, such as COLMAP, are not included.
    """
    try:
        import resource
    except ImportError:  # Windows
        return None
    if sys.platform == "darwin":
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:  # ru_maxrss of Linux includes the memory of the parent at the start of the process
        rows = (line.split() for line in Path("/proc/self/status").read_text().splitlines())
        return next(1024 * int(row[1]) for row in rows if row[0] == "VmHWM:")
    except (OSError, StopIteration):
        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
