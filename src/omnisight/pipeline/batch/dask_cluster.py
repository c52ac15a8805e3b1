"""Workers of a Dask cluster."""

import importlib.metadata
import logging
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from typing import Any

from omnisight.parallel import thread_count
from omnisight.pipeline.batch.local_processes import MAX_ATTEMPTS, QUEUE_LENGTH, lost
from omnisight.pipeline.batch.records import Shard, ShardRecord

# Time after which a scheduler that does not answer counts as unreachable, seconds.
TIMEOUT_S = 20
LOCAL = "local"
# Settings of Dask on this machine. Workers keep the memory of an image for the next one, as processes without Dask do,
# instead of returning it to the system: 18 % of the CPU time of views of 320 px. Dask measures itself less often or not
# at all: its own work is 1.2 % of a core instead of 3.2 %.
LOCAL_SETTINGS = {
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 32 << 20,
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 64 << 20,
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.tick.interval": "500ms",
}


class DaskCluster:
    """The workers of a Dask scheduler, which replaces those that die.

    Attributes
    ----------
    workers
        Number of threads of all workers: each processes a shard.
    link
        Address of the dashboard.
    """

    def __init__(self, address: str, workers: int | None = None) -> None:
        """Connect to a scheduler, or start one with workers on this machine.

        Raises
        ------
        ValueError
            If Dask is not installed, the scheduler does not answer, has no workers, or a worker has no omnisight of
            this version.
        """
        try:
            import dask.config  # pyright: ignore[reportMissingImports]
            from distributed import Client, LocalCluster  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise ValueError("--cluster needs Dask: pip install 'omnisight[cluster]'") from None
        self._cluster: Any = None
        if address == LOCAL:
            with dask.config.set(LOCAL_SETTINGS):
                self._cluster = LocalCluster(
                    n_workers=workers or thread_count(),
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
        try:
            self._client: Any = Client(self._cluster or address, timeout=TIMEOUT_S)
        except (OSError, TimeoutError) as error:
            raise ValueError(
                f"{address}: no Dask scheduler answers within {TIMEOUT_S} s: start one (dask scheduler), or check the"
                f" address, the network and TLS ({error})"
            ) from None
        self.link = str(self._client.dashboard_link)
        self.workers = sum(self._client.nthreads().values())
        self._check_workers(address)

    def _check_workers(self, address: str) -> None:
        import omnisight

        if self.workers == 0:
            raise ValueError(f"{address}: the scheduler has no workers: start some (dask worker {address})")
        try:
            # A function of omnisight would not reach a worker that has none.
            versions = self._client.run(importlib.metadata.version, "omnisight")
        except ImportError as error:
            raise ValueError(
                f"{address}: a worker has no omnisight ({error}): install {omnisight.__version__} on all of them"
            ) from None
        if others := {worker: version for worker, version in versions.items() if version != omnisight.__version__}:
            worker, version = next(iter(others.items()))
            raise ValueError(
                f"{address}: the worker {worker} has omnisight {version}, this machine {omnisight.__version__}: install"
                " the same version on all of them"
            )

    def run(
        self, work: Callable[..., ShardRecord], arguments: Sequence[Any], shards: Sequence[Shard]
    ) -> Generator[ShardRecord]:
        """Yield the record work(*arguments, shard) of each shard as it finishes."""
        from distributed import CancelledError, KilledWorker, as_completed  # pyright: ignore[reportMissingImports]

        waiting, attempts = list(reversed(shards)), Counter[int]()
        shared = self._share(arguments)
        of_key = dict[str, Shard]()

        def submit() -> Any:
            shard = waiting.pop()
            future = self._client.submit(work, *shared, shard, pure=False, retries=MAX_ATTEMPTS - 1)
            of_key[future.key] = shard
            return future

        running = as_completed([submit() for _ in range(min(len(waiting), QUEUE_LENGTH * self.workers))])
        for future in running:
            shard, record = of_key.pop(future.key), None
            try:
                record = future.result()
            except KilledWorker:
                record = lost(shard)
            except CancelledError:  # all workers that had the arguments died
                attempts[shard.index] += 1
                if attempts[shard.index] < MAX_ATTEMPTS:
                    waiting.append(shard)
                    shared = self._share(arguments)
                else:
                    record = lost(shard)
            if waiting:
                running.add(submit())
            if record is not None:
                yield record

    def _share(self, arguments: Sequence[Any]) -> Any:
        """Send arguments, which can be large, to all workers once."""
        return self._client.scatter(list(arguments), broadcast=True, hash=False)

    def close(self) -> None:
        """Disconnect, and stop the workers that were started."""
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()
