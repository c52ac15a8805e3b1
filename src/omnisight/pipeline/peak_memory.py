"""Memory of the process."""

import sys


def peak_memory_bytes() -> int | None:
    """Return the largest resident memory of the process so far; None if the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
