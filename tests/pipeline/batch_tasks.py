"""Tasks of the tests of batches, in a module that workers import."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Reverse:
    """Write the bytes of a file in reverse, slowly; files of some names are refused, or kill the worker."""

    marker: str = ""
    seconds: float = 0.0
    suffix: str = ".txt"

    @property
    def description(self):
        return {"command": "reverse", "version": 1}

    def prepare(self):
        def work(data, name):
            time.sleep(self.seconds)
            if name.startswith("refused"):
                raise ValueError(f"{name}: refused")
            if name.startswith("deadly"):
                os.kill(os.getpid(), signal.SIGKILL)
            if name.startswith("once") and not Path(self.marker).exists():
                Path(self.marker).touch()
                os.kill(os.getpid(), signal.SIGKILL)
            return data[::-1]

        return work


@dataclass(frozen=True)
class OtherReverse(Reverse):
    """The same task of another version."""

    @property
    def description(self):
        return {"command": "reverse", "version": 2}
