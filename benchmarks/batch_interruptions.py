"""Batches in which two workers and the client are killed."""

import argparse
import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

# Shares of the images after which a worker, another worker and the client are killed.
KILLS = 0.2, 0.4, 0.6
POLL_S = 0.05


def digests(folder: Path) -> dict[str, str]:
    """Return the hash of each view."""
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in folder.glob("*.png")}


def interrupt_local_cluster(command: Sequence[str], output: Path, options: argparse.Namespace) -> str:
    """Run a command on a cluster that it starts, and kill workers and the command; return what happened."""
    import psutil

    def workers(client: subprocess.Popen[bytes]) -> list[int]:
        # A worker is a process that multiprocessing has started; the client has a process that tracks resources, too.
        children = psutil.Process(client.pid).children(recursive=True)
        return [child.pid for child in children if "spawn_main" in " ".join(child.cmdline())]

    return _interrupted([*command, "--cluster", "local", "--workers", str(options.workers)], output, options, workers)


def interrupt_scheduler(command: Sequence[str], output: Path, options: argparse.Namespace) -> str:
    """Run a command on workers that have joined a scheduler over TCP, and kill workers and the command."""
    import distributed

    with _scheduler(options.workers) as address:

        def workers(client: subprocess.Popen[bytes]) -> list[int]:
            with distributed.Client(address, timeout=60) as other:
                other.wait_for_workers(options.workers, timeout=60)
                return list(other.run(os.getpid).values())

        return _interrupted([*command, "--cluster", address], output, options, workers)


@contextmanager
def _scheduler(workers: int) -> Generator[str]:
    """Start a scheduler and workers on this machine; yield its address."""
    import distributed

    start = [sys.executable, "-m"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    port = ["--host", "127.0.0.1", "--port", "18786", "--dashboard-address", "127.0.0.1:0"]
    processes = [subprocess.Popen([*start, "distributed.cli.dask_scheduler", *port], **quiet)]
    address = "tcp://127.0.0.1:18786"
    arguments = [address, "--nthreads", "1", "--nworkers", str(workers), "--host", "127.0.0.1"]
    processes.append(subprocess.Popen([*start, "distributed.cli.dask_worker", *arguments], **quiet))
    try:
        with distributed.Client(address, timeout=60) as client:
            client.wait_for_workers(workers, timeout=60)
        yield address
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def _interrupted(
    command: Sequence[str],
    output: Path,
    options: argparse.Namespace,
    workers: Callable[[subprocess.Popen[bytes]], list[int]],
) -> str:
    """Run a command, kill workers and then the command, run it again, and return what happened."""
    events, start = list[str](), time.perf_counter()
    shards = output / ".omnisight" / "shards"
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as client:
        for kill, share in enumerate(KILLS):
            while not shards.is_dir() or 100 * len(list(shards.glob("*.json"))) < share * options.images:
                if client.poll() is not None:
                    raise RuntimeError(f"the command ended before {share:.0%} of the images were done")
                time.sleep(POLL_S)
            is_client = kill == len(KILLS) - 1
            target = client.pid if is_client else workers(client)[kill % options.workers]
            os.kill(target, signal.SIGKILL)
            events.append(f"{'client' if is_client else 'worker'} killed after {share:.0%}")
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return f"{', '.join(events)}, {time.perf_counter() - start:.0f} s with the second run"
