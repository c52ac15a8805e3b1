"""Running the compiled loops, spread over the cores: they release Python's lock, so plain threads do."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any


def thread_count() -> int:
    """Give how many threads to use: `OMNISIGHT_THREADS`, or as many as this process may run on."""
    if asked := os.environ.get("OMNISIGHT_THREADS", ""):
        return max(1, int(asked)) if asked.isdigit() else 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool(process: int) -> ThreadPoolExecutor:
    # By process: threads do not survive a fork.
    return ThreadPoolExecutor(thread_count(), thread_name_prefix="omnisight")


def spread(work: Callable[[int, int], Any], count: int, grain: int) -> None:
    """Call work(first, last) over 0 ... count, in as many pieces as there are threads, each of `grain` or more."""
    pieces = min(thread_count(), count // grain)
    if pieces < 2:
        work(0, count)
        return
    edges = [count * i // pieces for i in range(pieces + 1)]
    waiting = [_pool(os.getpid()).submit(work, a, b) for a, b in pairwise(edges[1:])]
    work(edges[0], edges[1])
    for piece in waiting:
        piece.result()


def run(loop: str, models: tuple[str, ...], *arguments: Any, count: int, grain: int = 16384) -> None:
    """Run a compiled loop for models by name over `count` rows, on all cores where there are enough of them."""
    from omnisight.models import _kernels

    function = _kernels.compiled(loop, *models)
    spread(lambda first, last: function(*arguments, first, last), count, grain)
