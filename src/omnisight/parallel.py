"""Parallel loops on threads: compiled code releases the interpreter lock."""

import contextlib
import os
import queue
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def thread_count() -> int:
    """Return the number of threads: `OMNISIGHT_THREADS`, or the number of cores available to this process."""
    if setting := os.environ.get("OMNISIGHT_THREADS", ""):
        return max(1, int(setting)) if setting.isdigit() else 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool(process: int) -> ThreadPoolExecutor:
    # One pool per process: threads do not survive a fork.
    return ThreadPoolExecutor(thread_count(), thread_name_prefix="omnisight")


def parallel_for(work: Callable[[int, int], Any], count: int, grain: int) -> None:
    """Call work(first, last) over 0 ... count, in one piece per thread, each of at least `grain`."""
    pieces = min(thread_count(), count // grain)
    if pieces < 2:
        work(0, count)
        return
    edges = [count * i // pieces for i in range(pieces + 1)]
    futures = [_pool(os.getpid()).submit(work, a, b) for a, b in pairwise(edges[1:])]
    work(edges[0], edges[1])
    for future in futures:
        future.result()


def parallel_map(
    work: Callable[[Item], Result], items: Sequence[Item], progress: Callable[[int, int], None] | None = None
) -> list[Result]:
    """Return work(item) of all items in order; `progress` is called with the number of finished items and of all."""
    report = progress or (lambda done, total: None)
    results: list[Result] = []
    if thread_count() < 2 or len(items) < 2:
        for item in items:
            results.append(work(item))
            report(len(results), len(items))
        return results
    for result in _pool(os.getpid()).map(work, items):
        results.append(result)
        report(len(results), len(items))
    return results


def prefetch(items: Iterable[Item], count: int = 2) -> Generator[Item]:
    """Return the items of an iterator, which a thread computes up to `count` items ahead."""
    waiting: queue.Queue[tuple[Item | None, BaseException | None]] = queue.Queue(count)
    stop = threading.Event()

    def put(item: Item | None, error: BaseException | None = None) -> None:
        while not stop.is_set():
            with contextlib.suppress(queue.Full):
                waiting.put((item, error), timeout=0.1)
                return

    def run() -> None:
        try:
            for item in items:
                put(item)
                if stop.is_set():
                    return
            put(None)
        except BaseException as error:  # raised where the items are used
            put(None, error)

    thread = threading.Thread(target=run, name="omnisight prefetch", daemon=True)
    thread.start()
    try:
        while True:
            item, error = waiting.get()
            if error is not None:
                raise error
            if item is None:
                return
            yield item
    finally:
        stop.set()
        thread.join()
