"""Options of commands that process many files.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """Options of a batch.

    Attributes
    ----------
    workers
        Process the images in so many processes on this machine, and continue a run that was interrupted. By default one
        for each core, for URLs and for 1000 images or more.
    cluster
        Process the images on a Dask cluster: the address of its scheduler, such as tcp://host:8786, or local.
    """

    workers: int | None = None
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise ValueError(f"--workers must be 1 or more, got {self.workers}")
        if self.cluster is not None and self.cluster != "local" and "://" not in self.cluster:
            raise ValueError(
                "--cluster must be local or the address of a Dask scheduler, such as tcp://host:8786, got"
                f" {self.cluster!r}"
            )
        if self.workers is not None and self.cluster not in (None, "local"):
            raise ValueError("--workers applies to this machine: a cluster has the workers that were started for it")
