"""Ctrl-C where C code discards exceptions."""

import ctypes
import os
import signal
import sys
import threading
import time
from contextlib import suppress

import pytest

from omnisight.persistent_interruption import persistent_interruption, until_interrupted


@pytest.fixture(autouse=True)
def handled():
    """Handle SIGINT as in a terminal; shells start background jobs with the signal ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def press():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.01)  # the handler runs


def discarded_by_a_callback():
    ctypes.CFUNCTYPE(None)(press)()


def discarded_by_a_destructor():
    class Pressing:
        __del__ = staticmethod(press)

    Pressing()


def discarded_without_a_trace():
    with suppress(KeyboardInterrupt):
        press()


@pytest.mark.parametrize("discard", [discarded_by_a_callback, discarded_by_a_destructor, discarded_without_a_trace])
def test_an_interruption_that_is_discarded_is_raised_again(discard, capsys):
    with persistent_interruption() as interruption:
        discard()
        assert interruption.is_pending
        start = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            time.sleep(5)
    assert time.monotonic() - start < 1
    assert capsys.readouterr().err == ""
    time.sleep(0.5)  # it is not raised after the block


def test_blocks_that_handle_an_interruption_are_not_interrupted_again():
    done = []

    def work():
        try:
            press()
        finally:
            try:
                raise FileNotFoundError  # of the cleanup
            except FileNotFoundError:
                time.sleep(0.7)
            done.append(True)

    with persistent_interruption(), pytest.raises(KeyboardInterrupt):
        work()
    assert done == [True]


def test_a_second_interruption_ends_the_block_that_handles_the_first():
    start = time.monotonic()

    def work():
        try:
            press()
        finally:
            press()
            time.sleep(5)

    with persistent_interruption(), pytest.raises(KeyboardInterrupt):
        work()
    assert time.monotonic() - start < 1


def test_the_usual_end_of_a_block_is_no_interruption():
    with persistent_interruption() as interruption:
        with until_interrupted():
            press()
        assert not interruption.is_pending
        time.sleep(0.7)


def test_handlers_are_those_of_before_afterwards_and_in_other_threads():
    before = signal.getsignal(signal.SIGINT), sys.unraisablehook
    with persistent_interruption():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), sys.unraisablehook) == before
    handlers = []

    def run():
        with persistent_interruption():
            handlers.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert handlers == [before[0]]
