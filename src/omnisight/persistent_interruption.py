"""Ctrl-C of the command line: `KeyboardInterrupt` is raised again where a library has discarded it.

Python raises it wherever the main thread is, and C code that calls Python cannot always pass it on: callbacks of LLVM
while compiled code is loaded, destructors, and lookups of attributes by extension modules discard it.
"""

import _thread
import signal
import sys
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType
from typing import Any

# Seconds after which an interruption that is not handled is raised again.
RETRY_S = 0.2


class Interruption:
    """A handler of Ctrl-C.

    Attributes
    ----------
    is_pending
        Whether Ctrl-C was pressed, and the program has not ended or handled it.
    """

    def __init__(self) -> None:
        self.is_pending = self._is_retry = False

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Raise `KeyboardInterrupt`, and again until it is handled."""
        is_retry, self._is_retry = self._is_retry, False
        if is_retry and (not self.is_pending or _is_handled()):
            return
        if not self.is_pending:
            self.is_pending = True
            # `threading.Thread` takes locks, which the interrupted code may hold.
            _thread.start_new_thread(self._retry, ())
        raise KeyboardInterrupt

    def _retry(self) -> None:
        """Call `handle` in the main thread from time to time."""
        while self.is_pending:
            time.sleep(RETRY_S)
            if self.is_pending:
                self._is_retry = True
                _signal_main_thread()


_current = list[Interruption]()


@contextmanager
def persistent_interruption() -> Generator[Interruption]:
    """Raise `KeyboardInterrupt` after Ctrl-C until the block ends, or one of `until_interrupted` inside of it."""
    interruption = Interruption()
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield interruption
        return
    report = sys.unraisablehook

    def report_others(error: Any) -> None:
        if not issubclass(error.exc_type, KeyboardInterrupt):
            report(error)

    _current.append(interruption)
    signal.signal(signal.SIGINT, interruption.handle)
    sys.unraisablehook = report_others
    try:
        yield interruption
    finally:
        interruption.is_pending = False
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.unraisablehook = report
        _current.remove(interruption)


@contextmanager
def until_interrupted() -> Generator[None]:
    """Run a block whose usual end is Ctrl-C."""
    try:
        yield
    except KeyboardInterrupt:
        for interruption in _current:
            interruption.is_pending = False


def _signal_main_thread() -> None:
    """Call the handler of Ctrl-C in the main thread, also if it waits for a system call."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:  # Windows, where this ends waiting too
        _thread.interrupt_main()


def _is_handled() -> bool:
    """Return whether `KeyboardInterrupt` has reached an `except`, `with` or `finally` block of this thread."""
    error = sys.exception()
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False
