"""Options of commands that process many files.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass

from omnisight.choices import Options


@dataclass(frozen=True, kw_only=True)
class BatchOptions(Options):
    """Options of a batch.

    Attributes
    ----------
    workers
        Process a folder with its sub-folders by this number of processes on this machine, and continue a run that was
        interrupted. By default one for each core if images or output are URLs, such as s3://bucket/folder.
    cluster
        The same on a Dask cluster: the address of its scheduler, such as tcp://host:8786, or local.
    shard_size
        Images that a worker processes in a row: after an interruption, at most these are processed again. By default a
        quarter of those of a worker, and at most 100.
    """

    workers: int | None = None
    cluster: str | None = None
    shard_size: int | None = None

    @property
    def has_workers(self) -> bool:
        """Whether workers are specified."""
        return self.workers is not None or self.cluster is not None

    def apply_to(self, *files: str) -> bool:
        """Return whether files are processed as a batch: if workers are specified, or a file is a URL."""
        return self.has_workers or any("://" in file for file in files)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.workers is not None and self.workers < 1:
            raise ValueError(f"--workers must be 1 or more, got {self.workers}")
        if self.shard_size is not None and self.shard_size < 1:
            raise ValueError(f"--shard-size must be 1 or more, got {self.shard_size}")
        if self.cluster is not None and self.cluster != "local" and "://" not in self.cluster:
            raise ValueError(
                "--cluster must be local or the address of a Dask scheduler, such as tcp://host:8786, got"
                f" {self.cluster!r}"
            )
        if self.workers is not None and self.cluster not in (None, "local"):
            raise ValueError("--workers applies to this machine: a cluster has the workers that were started for it")
