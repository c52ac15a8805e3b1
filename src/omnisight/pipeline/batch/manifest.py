"""The list of a batch's work: files in shards, which are done or not."""

import json
import posixpath
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from omnisight.pipeline.batch.storage import read_all_below, read_below, write_file
from omnisight.pipeline.batch.task import Task

FOLDER = ".omnisight"
MANIFEST, RECORDS = f"{FOLDER}/manifest.json", f"{FOLDER}/shards"


@dataclass(frozen=True)
class Shard:
    """Files that one worker processes in a row.

    Attributes
    ----------
    index
        Number of the shard.
    paths
        The files, in the file system of the source.
    outputs
        The output of each, below the output folder.
    """

    index: int
    paths: tuple[str, ...]
    outputs: tuple[str, ...]


@dataclass(frozen=True)
class ShardRecord:
    """What is stored of a finished shard.

    Attributes
    ----------
    index
        Number of the shard.
    images
        Number of its files.
    failed
        Path and reason of each file without an output.
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
    """All files of a run, in the order of their shards.

    Attributes
    ----------
    task
        Description of the task.
    source
        URL of the files.
    paths, outputs
        Each file, and its output below the output folder.
    shard_size
        Number of files of a shard.
    """

    task: dict[str, Any]
    source: str
    paths: tuple[str, ...]
    outputs: tuple[str, ...]
    shard_size: int

    @property
    def shards(self) -> list[Shard]:
        """The shards."""
        starts = range(0, len(self.paths), self.shard_size)
        parts = [slice(start, start + self.shard_size) for start in starts]
        return [Shard(i, self.paths[part], self.outputs[part]) for i, part in enumerate(parts)]


def open_manifest(task: Task, source: str, paths: Sequence[str], output: str, shard_size: int) -> Manifest:
    """Return the manifest of a run: that of the output folder if the run was started before, else a new one.

    Raises
    ------
    ValueError
        If the folder has the manifest of another task or of other files.
    """
    manifest = Manifest(task.description, source, tuple(paths), tuple(output_names(paths, task.suffix)), shard_size)
    stored = read_below(output, MANIFEST)
    if stored is None:
        write_file(output, MANIFEST, json.dumps(asdict(manifest)).encode())
        return manifest
    try:
        known = json.loads(stored)
        before = Manifest(**known | {name: tuple(known[name]) for name in ("paths", "outputs")})
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{output}/{MANIFEST}: is not a manifest; delete the folder {FOLDER} to start again") from None
    advice = f"choose another output, or delete {output}/{FOLDER} to start again"
    if changed := [name for name in manifest.task if before.task.get(name) != manifest.task[name]]:
        name = changed[0]
        raise ValueError(
            f"{output}: holds a run with another {name.replace('_', ' ')} ({before.task.get(name)!r}, now"
            f" {manifest.task[name]!r}): {advice}"
        )
    if before.paths != manifest.paths:
        added, removed = len(set(paths) - set(before.paths)), len(set(before.paths) - set(paths))
        raise ValueError(
            f"{output}: holds a run over other images of {before.source} ({added} new, {removed} missing): {advice}"
        )
    return before


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
