"""Workers that are processes on this machine."""

import multiprocessing
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any

from omnisight.pipeline.batch.records import Shard, ShardRecord

# A shard whose worker dies so often is not started again, because its images are likely to be the cause.
MAX_ATTEMPTS = 3
# Shards that wait for each worker.
QUEUE_LENGTH = 2
LOST = "the worker died {} times while it processed the images of this shard: not enough memory?"

# What a process does with a shard, after `_receive`.
_work: Callable[[Shard], ShardRecord]


class LocalProcesses:
    """Processes on this machine, which are replaced if they die."""

    link = ""

    def __init__(self, workers: int) -> None:
        """Prepare for a number of processes."""
        self.workers = workers

    def run(
        self, work: Callable[..., ShardRecord], arguments: Sequence[Any], shards: Sequence[Shard]
    ) -> Generator[ShardRecord]:
        """Yield the record work(*arguments, shard) of each shard as it finishes.

        The death of a process ends all of them. Each shard that was running is then processed alone: the shard
        that is the cause becomes known and the others are not lost with it.
        """
        waiting, suspects, attempts = list(reversed(shards)), list[Shard](), Counter[int]()
        while waiting or suspects:
            queue, workers = ([suspects.pop()], 1) if suspects else (waiting, self.workers)
            running = dict[Future[ShardRecord], Shard]()
            with self._pool(workers, work, arguments) as pool:
                try:
                    while queue or running:
                        while queue and len(running) < QUEUE_LENGTH * workers:
                            running[pool.submit(_run, queue[-1])] = queue[-1]
                            queue.pop()
                        for future in wait(running, return_when=FIRST_COMPLETED).done:
                            record = future.result()
                            del running[future]
                            yield record
                except BrokenProcessPool:
                    attempts.update(shard.index for shard in running.values())
                finally:
                    pool.shutdown(wait=True, cancel_futures=True)
            yield from (lost(shard) for shard in running.values() if attempts[shard.index] >= MAX_ATTEMPTS)
            suspects += [shard for shard in running.values() if attempts[shard.index] < MAX_ATTEMPTS]

    @staticmethod
    def _pool(workers: int, work: Callable[..., ShardRecord], arguments: Sequence[Any]) -> ProcessPoolExecutor:
        """Return processes that have received the arguments, which can be large, once."""
        # Threads of this process do not survive a fork.
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(workers, context, initializer=_receive, initargs=(work, tuple(arguments)))

    def close(self) -> None:
        """Release the workers."""


def _receive(work: Callable[..., ShardRecord], arguments: tuple[Any, ...]) -> None:
    """Keep the work of this process."""
    global _work
    _work = partial(work, *arguments)


def _run(shard: Shard) -> ShardRecord:
    """Process a shard in a process that has received its work."""
    return _work(shard)


def lost(shard: Shard) -> ShardRecord:
    """Return the record of a shard whose workers died; it is not stored, and a later run tries again."""
    reason = LOST.format(MAX_ATTEMPTS)
    return ShardRecord(shard.index, {}, {item.name: reason for item in shard.items})
