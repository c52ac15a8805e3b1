"""The work of one shard, in a worker."""

import json
import os
import time
from collections.abc import Callable

from omnisight.pipeline.batch.manifest import Shard, ShardRecord
from omnisight.pipeline.batch.storage import read_file, write_file
from omnisight.pipeline.batch.task import Task
from omnisight.pipeline.peak_memory import peak_memory_bytes

# What a task computes once, such as the map of a camera. A worker serves one run at a time.
_prepared: dict[str, Callable[[bytes, str], bytes]] = {}


def run_shard(task: Task, source: str, output: str, shard: Shard) -> ShardRecord:
    """Process the files of a shard, write their outputs, and then the record that it is finished.

    A shard may be repeated: it writes the same bytes. Files that cannot be used are listed in the record.

    Raises
    ------
    OSError
        If an output cannot be written.
    """
    start = time.perf_counter()
    process = _function(task)
    failed = list[tuple[str, str]]()
    for path, name in zip(shard.paths, shard.outputs, strict=True):
        try:
            data = process(read_file(source, path), path.rsplit("/", 1)[-1])
        except ValueError as error:
            failed.append((path, str(error)))
            continue
        except OSError as error:
            failed.append((path, f"cannot be read: {error}"))
            continue
        write_file(output, name, data)
    seconds = time.perf_counter() - start
    record = ShardRecord(shard.index, len(shard.paths), tuple(failed), seconds, (peak_memory_bytes() or 0) / 1e6)
    record.write(output)
    return record


def _function(task: Task) -> Callable[[bytes, str], bytes]:
    """Return the prepared function of a task; each file has one thread, because there is a worker for each core."""
    import cv2

    key = json.dumps(task.description, sort_keys=True)
    if key not in _prepared:
        os.environ["OMNISIGHT_THREADS"] = "1"
        cv2.setNumThreads(1)
        _prepared.clear()
        _prepared[key] = task.prepare()
    return _prepared[key]
