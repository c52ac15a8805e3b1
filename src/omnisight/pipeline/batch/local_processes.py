"""Workers that are processes on this machine."""

import multiprocessing
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from omnisight.pipeline.batch.manifest import Shard, ShardRecord

# A shard whose worker dies so often is not started again, because its images are likely to be the cause.
MAX_ATTEMPTS = 3
# Shards that wait for each worker.
QUEUE_LENGTH = 2
LOST = "the worker died {} times while it processed the images of this shard: not enough memory?"


class LocalProcesses:
    """Processes on this machine, which are replaced if they die."""

    link = ""

    def __init__(self, workers: int) -> None:
        """Prepare for a number of processes."""
        self.workers = workers

    def run(
        self, work: Callable[..., ShardRecord], arguments: Sequence[Any], shards: Sequence[Shard]
    ) -> Generator[ShardRecord]:
        """Yield the record work(*arguments, shard) of each shard as it finishes."""
        waiting, attempts = list(reversed(shards)), Counter[int]()
        while waiting:
            running = dict[Future[ShardRecord], Shard]()
            # Threads of this process do not survive a fork.
            with ProcessPoolExecutor(self.workers, mp_context=multiprocessing.get_context("spawn")) as pool:
                try:
                    while waiting or running:
                        while waiting and len(running) < QUEUE_LENGTH * self.workers:
                            running[pool.submit(work, *arguments, waiting[-1])] = waiting[-1]
                            waiting.pop()
                        for future in wait(running, return_when=FIRST_COMPLETED).done:
                            record = future.result()
                            del running[future]
                            yield record
                except BrokenProcessPool:
                    attempts.update(shard.index for shard in running.values())
                finally:
                    pool.shutdown(wait=True, cancel_futures=True)
            yield from (lost(shard) for shard in running.values() if attempts[shard.index] >= MAX_ATTEMPTS)
            waiting += [shard for shard in running.values() if attempts[shard.index] < MAX_ATTEMPTS]

    def close(self) -> None:
        """Release the workers."""


def lost(shard: Shard) -> ShardRecord:
    """Return the record of a shard whose workers died; it is not stored, so that a later run tries again."""
    reason = LOST.format(MAX_ATTEMPTS)
    return ShardRecord(shard.index, len(shard.paths), tuple((path, reason) for path in shard.paths), 0.0, 0.0)
