"""A batch: one task for many files, with a result that does not depend on interruptions."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import chain

from omnisight.display import Displayed
from omnisight.parallel import thread_count
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.batch.dask_cluster import DaskCluster
from omnisight.pipeline.batch.local_processes import LocalProcesses
from omnisight.pipeline.batch.manifest import check_manifest
from omnisight.pipeline.batch.records import read_records, shards_of
from omnisight.pipeline.batch.shard import run_shard
from omnisight.pipeline.batch.storage import absolute_url, refuse_overwrite
from omnisight.pipeline.batch.task import Item, Task
from omnisight.progress import Progress, no_progress


@dataclass(frozen=True)
class BatchResult(Displayed):
    """The result of a batch.

    Attributes
    ----------
    images
        Number of items: of images, or of frames of several images.
    written
        Number of items with outputs.
    failed
        First input and reason of each item without outputs.
    resumed
        Number of items that earlier runs had finished.
    workers
        Number of workers; 0 if everything was finished.
    seconds
        Duration of this run.
    peak_mb
        Largest memory of a worker, MB.
    """

    images: int
    written: int
    failed: tuple[tuple[str, str], ...]
    resumed: int
    workers: int
    seconds: float
    peak_mb: float

    @property
    def images_per_second(self) -> float:
        """Items of this run per second."""
        return (self.images - self.resumed) / max(self.seconds, 1e-9)


@dataclass(frozen=True)
class Batch(Displayed):
    """How many files are processed: the folder of the results, the workers, and the progress.

    Attributes
    ----------
    output
        Folder of the results, a path or a URL.
    options
        Where the workers are.
    progress
        Called with the stage, the number of items done, and of all.
    """

    output: str
    options: BatchOptions = BatchOptions()
    progress: Progress = no_progress

    def run(self, task: Task, items: Sequence[Item], source: str) -> BatchResult:
        """Process files, and write the results to the folder.

        Shards of items are processed by workers. Each stores a record of the shard after its outputs, so a run
        that was killed continues where it stopped. Items whose files have changed since are processed again.

        Parameters
        ----------
        task
            What is done with each item.
        items
            The files and their outputs.
        source
            A path or URL in the file system of the files, one that fsspec opens (s3://, gs://, az://,
            zip://*::archive.zip).

        Raises
        ------
        ValueError
            If an output would overwrite an input, the output holds another run, or the cluster cannot be used.
        OSError
            If an output cannot be written; what is finished remains.
        """
        start = time.perf_counter()
        outputs = chain.from_iterable(item.outputs for item in items)
        refuse_overwrite(self.output, outputs, source, chain.from_iterable(item.inputs for item in items))
        check_manifest(task, items, source, self.output)
        records = read_records(self.output)
        remaining = records.unfinished(items)
        resumed, workers = len(items) - len(remaining), 0
        if remaining:
            with closing(_workers(self.options)) as pool:
                workers = pool.workers
                report = self._reporter(pool, resumed, len(items))
                # Workers of a cluster have another working directory.
                arguments = task, absolute_url(source), absolute_url(self.output)
                shards = shards_of(remaining, records.count, self.options.shard_size, workers)
                try:
                    for record in pool.run(run_shard, arguments, shards):
                        records.add(record)
                        report(record.images)
                except OSError as error:
                    raise OSError(
                        f"{error}: resolve it, and the same command continues after the finished shards"
                    ) from None
        failed = tuple((item.name, records.failed[item.name]) for item in items if item.name in records.failed)
        return BatchResult(
            images=len(items),
            written=len(items) - len(failed),
            failed=failed,
            resumed=resumed,
            workers=workers,
            seconds=time.perf_counter() - start,
            peak_mb=records.peak_mb,
        )

    def _reporter(self, pool: LocalProcesses | DaskCluster, done: int, total: int) -> Callable[[int], None]:
        """Return a function that adds to the number of items done, and reports it with the workers and their dashboard.

        Items that are done before are reported first, and therefore do not count for the speed.
        """
        stage = f"images, {pool.workers} workers" + (f", {pool.link}" if pool.link else "")

        def add(count: int) -> None:
            nonlocal done
            done += count
            self.progress(stage, done, total)

        add(0)
        return add


def _workers(options: BatchOptions) -> LocalProcesses | DaskCluster:
    if options.cluster is not None:
        return DaskCluster(options.cluster, options.workers)
    return LocalProcesses(options.workers or thread_count())
