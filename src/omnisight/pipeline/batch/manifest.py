"""The list of a batch's work: items in shards, which are done or not."""

import json
import posixpath
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

from omnisight.pipeline.batch.storage import read_all_below, read_below, write_file
from omnisight.pipeline.batch.task import Item, Task

FOLDER = ".omnisight"
MANIFEST, RECORDS = f"{FOLDER}/manifest.json", f"{FOLDER}/shards"


@dataclass(frozen=True)
class Shard:
    """Items that one worker processes in a row.

    Attributes
    ----------
    index
        Number of the shard.
    items
        The items.
    """

    index: int
    items: tuple[Item, ...]


@dataclass(frozen=True)
class ShardRecord:
    """What is stored of a finished shard.

    Attributes
    ----------
    index
        Number of the shard.
    images
        Number of its items.
    failed
        First input and reason of each item without outputs.
    seconds
        Time it took, without reading the task.
    peak_mb
        Largest memory of the worker so far, MB.
    """

    index: int
    images: int
    failed: tuple[tuple[str, str], ...]
    seconds: float
    peak_mb: float

    def write(self, output: str) -> None:
        """Store the record: the shard is finished from now on."""
        write_file(output, f"{RECORDS}/{self.index:07}.json", json.dumps(asdict(self)).encode())


@dataclass(frozen=True)
class Manifest:
    """All items of a run, in the order of their shards.

    Attributes
    ----------
    task
        Description of the task.
    source
        URL of the files.
    items
        The items.
    shard_size
        Number of items of a shard.
    """

    task: dict[str, Any]
    source: str
    items: tuple[Item, ...]
    shard_size: int

    @property
    def shards(self) -> list[Shard]:
        """The shards."""
        starts = range(0, len(self.items), self.shard_size)
        return [Shard(i, self.items[start : start + self.shard_size]) for i, start in enumerate(starts)]

    def to_json(self) -> str:
        """Return the content of the file of a manifest."""
        items = [[item.inputs, item.outputs, item.group] for item in self.items]
        return json.dumps({**vars(self), "items": items})

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Return the manifest of a file; raise ValueError, KeyError or TypeError if it is none."""
        values = json.loads(text)
        items = tuple(Item(tuple(inputs), tuple(outputs), group) for inputs, outputs, group in values["items"])
        return cls(**values | {"items": items})


def open_manifest(task: Task, items: Sequence[Item], source: str, output: str, shard_size: int) -> Manifest:
    """Return the manifest of a run: that of the output folder if the run was started before, else a new one.

    Raises
    ------
    ValueError
        If the folder has the manifest of another task or of other files.
    """
    manifest = Manifest(task.description, source, tuple(items), shard_size)
    stored = read_below(output, MANIFEST)
    if stored is None:
        write_file(output, MANIFEST, manifest.to_json().encode())
        return manifest
    try:
        before = Manifest.from_json(stored)
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{output}/{MANIFEST}: is not a manifest; delete the folder {FOLDER} to start again") from None
    advice = f"choose another output, or delete {output}/{FOLDER} to start again"
    was, now = _flat(before.task), _flat(manifest.task)
    if changed := [name for name in now | was if was.get(name) != now.get(name)]:
        name = changed[0]
        raise ValueError(
            f"{output}: holds a run with another {name.replace('_', ' ')} ({was.get(name)}, now {now.get(name)}):"
            f" {advice}"
        )
    if before.items != manifest.items:
        old, new = ({path for item in each.items for path in item.inputs} for each in (before, manifest))
        raise ValueError(
            f"{output}: holds a run over other images of {before.source} ({len(new - old)} new, {len(old - new)}"
            f" missing): {advice}"
        )
    return before


def _flat(task: dict[str, Any]) -> dict[str, Any]:
    """Return a description with the options of a command beside the other parts."""
    return {name: value for name, value in task.items() if name != "options"} | task.get("options", {})


def read_records(output: str) -> dict[int, ShardRecord]:
    """Return the records of finished shards; unreadable ones count as not finished."""
    records = dict[int, ShardRecord]()
    for text in read_all_below(output, RECORDS):
        try:
            values = json.loads(text)
            failed = tuple((str(path), str(reason)) for path, reason in values.pop("failed"))
            record = ShardRecord(**values, failed=failed)
        except (ValueError, KeyError, TypeError):
            continue
        records[record.index] = record
    return records


def items_of_images(paths: Sequence[str], suffix: str) -> list[Item]:
    """Return an item for each image, whose output has its path below their common folder, with another suffix."""
    names = output_names(paths, suffix)
    return [Item((path,), (name,)) for path, name in zip(paths, names, strict=True)]


def output_names(paths: Sequence[str], suffix: str) -> list[str]:
    """Return a unique output for each file: its path below the common folder, with another suffix."""
    root = posixpath.commonpath([posixpath.dirname(path) for path in paths])
    below = [posixpath.relpath(path, root or ".") for path in paths]
    stems = [posixpath.splitext(name)[0] for name in below]
    counts = Counter(stem.casefold() for stem in stems)
    return [
        (stem if counts[stem.casefold()] == 1 else name.replace(".", "_")) + suffix
        for stem, name in zip(stems, below, strict=True)
    ]
