"""Tasks of the tests of batches, in a module that workers import."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from omnisight.pipeline.batch.batch import Batch
from omnisight.pipeline.batch.manifest import items_of_images
from omnisight.pipeline.batch.storage import list_images


@dataclass(frozen=True)
class Reverse:
    """Write the bytes of a file in reverse, slowly; files of some names are refused, or kill the worker."""

    marker: str = ""
    seconds: float = 0.0

    @property
    def description(self):
        return {"command": "reverse", "version": 1}

    def prepare(self):
        def work(item, contents):
            (name,), (data,) = item.names, contents
            time.sleep(self.seconds)
            if name.startswith("refused"):
                raise ValueError(f"{name}: refused")
            if name.startswith("deadly"):
                os.kill(os.getpid(), signal.SIGKILL)
            if name.startswith("once") and not Path(self.marker).exists():
                Path(self.marker).touch()
                os.kill(os.getpid(), signal.SIGKILL)
            return [data[::-1]]

        return work


@dataclass(frozen=True)
class OtherReverse(Reverse):
    """The same task of another version."""

    @property
    def description(self):
        return {"command": "reverse", "version": 2}


def run(task, source, output, *arguments):
    """Run a task for all images of a folder."""
    return Batch(output, *arguments).run(task, items_of_images(list_images(source, output), ".txt"), source)
