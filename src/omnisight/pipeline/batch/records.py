"""Records of the work of a batch: one for each shard that was processed. A record is not changed later."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Self

from omnisight.pipeline.batch.storage import RECORDS_FOLDER, read_all_below, write_file
from omnisight.pipeline.batch.task import Item

# The scheduler takes about 1 ms for a task: 1 % of the time of a shard of images of 1 MP.
MAX_SHARD_SIZE = 100
# Shards for each worker: with several, all workers finish at about the same time.
SHARDS_PER_WORKER = 4


@dataclass(frozen=True)
class Shard:
    """Items that one worker processes in a row.

    Attributes
    ----------
    index
        Number of the shard, and of its record.
    items
        The items.
    """

    index: int
    items: tuple[Item, ...]


@dataclass(frozen=True)
class ShardRecord:
    """What is stored of a shard.

    Attributes
    ----------
    index
        Number of the shard.
    finished
        Names of the items that need not be processed again, and the versions of their files.
    failed
        Names of the items without outputs, and the reasons.
    seconds
        Time it took, without reading the task.
    peak_mb
        Largest memory of the worker so far, MB.
    """

    index: int
    finished: dict[str, str]
    failed: dict[str, str]
    seconds: float = 0.0
    peak_mb: float = 0.0

    @property
    def images(self) -> int:
        """Number of items."""
        return len(self.finished | self.failed)

    def write(self, output: str) -> None:
        """Store the record: its items are finished from now on."""
        write_file(output, f"{RECORDS_FOLDER}/{self.index:07}.json", json.dumps(asdict(self)).encode())

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Return the record of a file; raise ValueError, KeyError or TypeError if it is none."""
        values = json.loads(text)
        texts = [part for name in ("finished", "failed") for pair in values[name].items() for part in pair]
        if not all(isinstance(part, str) for part in texts):
            raise TypeError
        return cls(int(values["index"]), values["finished"], values["failed"], peak_mb=float(values["peak_mb"]))


@dataclass
class Records:
    """The records of a batch; a later record of an item supersedes an earlier one.

    Attributes
    ----------
    finished
        Names of the items that were processed, and the versions of their files at that time.
    failed
        Names of the items without outputs, and the reasons.
    count
        Number of the next record.
    peak_mb
        Largest memory of a worker, MB.
    """

    finished: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    count: int = 0
    peak_mb: float = 0.0

    def add(self, record: ShardRecord) -> None:
        """Add a later record."""
        for name in record.finished | record.failed:
            self.finished.pop(name, None)
            self.failed.pop(name, None)
        self.finished |= record.finished
        self.failed |= record.failed
        self.count = max(self.count, record.index + 1)
        self.peak_mb = max(self.peak_mb, record.peak_mb)

    def unfinished(self, items: Sequence[Item]) -> list[Item]:
        """Return the items that were not processed, or whose files have changed since."""
        return [item for item in items if self.finished.get(item.name) != item.version]


def read_records(output: str) -> Records:
    """Return the records in an output folder, without unreadable ones, whose items count as not finished."""
    found = list[ShardRecord]()
    for text in read_all_below(output, RECORDS_FOLDER):
        try:
            found.append(ShardRecord.from_json(text))
        except (ValueError, KeyError, TypeError, AttributeError):
            continue
    records = Records()
    for record in sorted(found, key=lambda record: record.index):
        records.add(record)
    return records


def shards_of(items: Sequence[Item], first: int, size: int | None, workers: int) -> list[Shard]:
    """Divide items into shards numbered from `first`, by default so small that each worker has several."""
    size = size or max(1, min(MAX_SHARD_SIZE, len(items) // (SHARDS_PER_WORKER * workers)))
    starts = range(0, len(items), size)
    return [Shard(first + i, tuple(items[start : start + size])) for i, start in enumerate(starts)]
