"""Parallel loops on threads: compiled code releases the interpreter lock."""

import contextlib
import os
import queue
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

from omnisight.progress import StageProgress, no_progress

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Argument = TypeVar("Argument")
Result = TypeVar("Result")


def thread_count() -> int:
    """Return the number of threads: `OMNISIGHT_THREADS`, or the number of cores available to this process."""
    if setting := os.environ.get("OMNISIGHT_THREADS", ""):
        return max(1, int(setting)) if setting.isdigit() else 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _OfThread(threading.local):
    """Whether the thread is one of the pool: a loop inside of a loop runs on it alone."""

    is_in_pool = False


_of_thread = _OfThread()


@cache
def _pool(process: int) -> ThreadPoolExecutor:
    # One pool per process: threads do not survive a fork.
    def start() -> None:
        _of_thread.is_in_pool = True

    return ThreadPoolExecutor(thread_count(), "omnisight", start)


def _free_threads() -> int:
    """Return the number of threads that a loop can use."""
    return 1 if _of_thread.is_in_pool else thread_count()


def parallel_for(work: Callable[[int, int], Any], count: int, grain: int) -> None:
    """Call work(first, last) over 0 ... count, in one piece per thread, each of at least `grain`."""
    pieces = count // grain
    if pieces > 1:
        pieces = min(pieces, _free_threads())
    if pieces < 2:
        work(0, count)
        return
    edges = [count * i // pieces for i in range(pieces + 1)]
    futures = [_pool(os.getpid()).submit(work, a, b) for a, b in pairwise(edges[1:])]
    work(edges[0], edges[1])
    for future in futures:
        future.result()


def in_background(work: Callable[[Argument], Result], argument: Argument) -> Future[Result]:
    """Start work(argument) on another thread; at once on this one if there is only one thread."""
    if _free_threads() > 1:
        return _pool(os.getpid()).submit(work, argument)
    done = Future[Result]()
    done.set_result(work(argument))
    return done


def parallel_map(
    work: Callable[[Item], Result], items: Sequence[Item], progress: StageProgress = no_progress
) -> list[Result]:
    """Return work(item) of all items in order; `progress` is called with the number of finished items and of all."""
    results: list[Result] = []
    if _free_threads() < 2 or len(items) < 2:
        for item in items:
            results.append(work(item))
            progress(len(results), len(items))
        return results
    with serial_blas():
        for result in _pool(os.getpid()).map(work, items):
            results.append(result)
            progress(len(results), len(items))
    return results


class _SerialBlas:
    """Number of callers that let BLAS use one thread, and its number of threads before."""

    def __init__(self) -> None:
        self.lock, self.callers, self.before = threading.Lock(), 0, contextlib.ExitStack()


_serial_blas = _SerialBlas()


@contextmanager
def serial_blas() -> Generator[None]:
    """Let BLAS use one thread.

    The threads of OpenBLAS wait for each other without sleeping: on two cores with two other busy processes, the
    Cholesky factorization of 1200 columns took 370 ms on average, and 40 ms with one thread.
    """
    with _serial_blas.lock:
        _serial_blas.callers += 1
        if _serial_blas.callers == 1:
            _serial_blas.before.enter_context(_blas("scipy.linalg" in sys.modules).limit(limits=1))
    try:
        yield
    finally:
        with _serial_blas.lock:
            _serial_blas.callers -= 1
            if not _serial_blas.callers:
                _serial_blas.before.close()


@cache
def _blas(has_scipy: bool) -> "ThreadpoolController":
    """Return the loaded BLAS libraries: that of numpy, and that of scipy."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


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
