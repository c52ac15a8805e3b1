"""How long work takes in units of other work: a machine that is slow or busy is so for both."""

import time

import numpy as np


def assert_quick(work, limit):
    """Call `work`; its processor time must stay below so many times that of a fixed piece of work done beside it.

    That piece takes 0.01 to 0.03 s. What takes too long is done once more: the first time, loops may be compiled.
    """
    tries = []
    while len(tries) < 2 and min(tries, default=np.inf) >= limit:
        times = [_processor_time(task) for task in (_yardstick, work, _yardstick)]
        tries.append(2 * times[1] / (times[0] + times[2]))
    assert min(tries) < limit, f"took {' and '.join(f'{t:.0f}' for t in tries)} times as long as the yardstick"


def _processor_time(task):
    begun = time.process_time()
    task()
    return time.process_time() - begun


def _yardstick():
    sum(i % 7 for i in range(200_000))
    np.sort(np.sin(np.arange(200_000.0)))
