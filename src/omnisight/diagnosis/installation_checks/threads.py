"""Check of the threads."""

import os

from omnisight.diagnosis.finding import Finding, Level
from omnisight.parallel import thread_count

PRIORITY = 20


def check() -> Finding:
    """Check the number of threads against that of the cores."""
    cores, threads, setting = os.cpu_count() or 1, thread_count(), os.environ.get("OMNISIGHT_THREADS", "")
    figure = f"{threads} of {cores} cores" + (f", OMNISIGHT_THREADS={setting}" if setting else "")
    if setting and not setting.isdigit():
        return Finding("threads", Level.WARNING, figure, "OMNISIGHT_THREADS is no number: unset it, or set a number")
    if threads > cores:
        return Finding("threads", Level.WARNING, figure, "more threads than cores are slower: unset OMNISIGHT_THREADS")
    return Finding("threads", Level.OK, figure)
