"""The work of one shard, in a worker."""

import json
import os
import threading
import time

from omnisight.images import reason_without_name
from omnisight.pipeline.batch.peak_memory import peak_memory_bytes
from omnisight.pipeline.batch.records import Shard, ShardRecord
from omnisight.pipeline.batch.storage import read_file, remove_file, write_file
from omnisight.pipeline.batch.task import Process, Task

# What a task computes once, such as the map of a camera. A worker serves one run at a time, on one or more threads.
_prepared: dict[str, Process] = {}
_preparing = threading.Lock()


def run_shard(task: Task, source: str, output: str, shard: Shard) -> ShardRecord:
    """Process the items of a shard, write their outputs, and then the record of those that are finished.

    A shard may be repeated: it writes the same bytes. Items that cannot be used are finished, and listed as failed;
    those that cannot be read, because of the network or credentials, are not finished, and the next run tries them
    again.

    Raises
    ------
    OSError
        If an output cannot be written.
    """
    start = time.perf_counter()
    process = _function(task)
    finished, failed = dict[str, str](), dict[str, str]()
    for item in shard.items:
        try:
            written = process(item, [read_file(source, path) for path in item.inputs])
        except ValueError as error:
            failed[item.name] = reason_without_name(error, item.name)
            for name in item.outputs:  # of an earlier version of its files
                remove_file(output, name)
        except OSError as error:
            failed[item.name] = f"cannot be read: {error}"
            continue
        else:
            for name, data in zip(item.outputs, written, strict=True):
                write_file(output, name, data)
        finished[item.name] = item.version
    seconds = time.perf_counter() - start
    record = ShardRecord(shard.index, finished, failed, seconds, (peak_memory_bytes() or 0) / 1e6)
    record.write(output)
    return record


def _function(task: Task) -> Process:
    """Return the prepared function of a task; each item has one thread, because there is a worker for each core."""
    import cv2

    key = json.dumps(task.description, sort_keys=True)
    with _preparing:
        if key not in _prepared:
            os.environ["OMNISIGHT_THREADS"] = "1"
            cv2.setNumThreads(1)
            _prepared.clear()
            _prepared[key] = task.prepare()
        return _prepared[key]
