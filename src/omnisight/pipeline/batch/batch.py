"""A batch: one task for many files, with a result that does not depend on interruptions."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass

from omnisight.display import Displayed
from omnisight.images.collect import IMAGE_SUFFIXES
from omnisight.parallel import thread_count
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.batch.dask_cluster import DaskCluster
from omnisight.pipeline.batch.local_processes import LocalProcesses
from omnisight.pipeline.batch.manifest import open_manifest, read_records
from omnisight.pipeline.batch.shard import run_shard
from omnisight.pipeline.batch.storage import is_below, is_url, list_files
from omnisight.pipeline.batch.task import Task

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class BatchResult(Displayed):
    """The result of a batch.

    Attributes
    ----------
    images
        Number of files.
    written
        Number of outputs.
    failed
        Path and reason of each file without an output.
    resumed
        Number of files that an earlier run had finished.
    workers
        Number of workers.
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
        """Files of this run per second."""
        return (self.images - self.resumed) / max(self.seconds, 1e-9)


def is_batch(images: Sequence[str], outputs: Sequence[str], options: BatchOptions) -> bool:
    """Return whether images are processed as a batch: if it is asked for, or if they are given by URL."""
    asked = options.workers is not None or options.cluster is not None
    return asked or any(map(is_url, [*images, *outputs]))


def run_batch(
    task: Task, source: str, output: str, options: BatchOptions = BatchOptions(), progress: Progress | None = None
) -> BatchResult:
    """Process all images of a folder, and write the results to another one.

    Shards of images are processed by workers. Each stores a record of the shard after its outputs, so that a run that
    was killed continues where it stopped.

    Parameters
    ----------
    task
        What is done with each image.
    source
        Folder, with its sub-folders, or pattern of images: a path or a URL that fsspec opens (s3://, gs://, az://,
        zip://*::archive.zip).
    output
        Folder of the results, a path or a URL.
    options
        Where the workers are.
    progress
        Called with the stage, the number of files done, and of all.

    Raises
    ------
    ValueError
        If there are no images, the output holds another run, or the cluster cannot be used.
    OSError
        If an output cannot be written; what is finished remains.
    """
    report = progress or (lambda stage, done, total: None)
    start = time.perf_counter()
    if is_below(output, source):
        raise ValueError(f"{output}: is in the folder of the images, so that views would be read as images next time")
    manifest = open_manifest(task, source, list_files(source, IMAGE_SUFFIXES), output, options.shard_size)
    records = read_records(output)
    remaining = [shard for shard in manifest.shards if shard.index not in records]
    total, resumed = len(manifest.paths), sum(record.images for record in records.values())
    done = resumed
    with closing(_workers(options)) as workers:
        stage = f"images, {workers.workers} workers" + (f", {workers.link}" if workers.link else "")
        report(stage, done, total)
        for record in workers.run(run_shard, (task, source, output), remaining):
            records[record.index] = record
            done += record.images
            report(stage, done, total)
    failed = tuple(failure for index in sorted(records) for failure in records[index].failed)
    return BatchResult(
        images=total,
        written=total - len(failed),
        failed=failed,
        resumed=resumed,
        workers=workers.workers,
        seconds=time.perf_counter() - start,
        peak_mb=max(record.peak_mb for record in records.values()),
    )


def _workers(options: BatchOptions) -> LocalProcesses | DaskCluster:
    if options.cluster is not None:
        return DaskCluster(options.cluster, options.workers)
    return LocalProcesses(options.workers or thread_count())
