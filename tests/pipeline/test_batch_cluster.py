"""Batches on a Dask cluster and in an object store, by real servers on this machine."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from batch_tasks import Reverse, run

from omnisight.pipeline.batch.batch_options import BatchOptions

pytestmark = pytest.mark.peer

FILES = {f"{i:03}.png": f"file {i}".encode() for i in range(40)}
WRITTEN = {name.replace("png", "txt"): data[::-1] for name, data in FILES.items()}


@pytest.fixture
def source(tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    for name, data in FILES.items():
        (folder / name).write_bytes(data)
    return folder


@pytest.fixture
def scheduler(tmp_path):
    """Start a scheduler and two workers joined over TCP; return its address and the processes of the workers."""
    pytest.importorskip("distributed")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}

    def start(*arguments):
        command = [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]]
        return subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.DEVNULL)

    file = tmp_path / "scheduler.json"
    options = ("--scheduler-file", str(file))
    main = start("scheduler", "--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0", *options)
    workers = [start("worker", "--host", "127.0.0.1", "--nthreads", "1", *options) for _ in range(2)]
    try:
        from distributed import Client

        with Client(scheduler_file=str(file), timeout=60) as client:
            client.wait_for_workers(2, timeout=60)
            address = client.scheduler.address
        yield address, workers
    finally:
        for process in (*workers, main):
            process.kill()
            process.wait()


def texts(folder):
    return {file.name: file.read_bytes() for file in folder.glob("*.txt")}


def test_workers_over_tcp_one_of_which_is_killed(source, tmp_path, scheduler):
    address, workers = scheduler
    killed = []

    def kill_one(stage, done, total):
        if done and not killed:
            assert "http://127.0.0.1" in stage
            killed.append(workers[0].pid)
            os.kill(workers[0].pid, signal.SIGKILL)

    options = BatchOptions(cluster=address, shard_size=4)
    result = run(Reverse(seconds=0.05), str(source), str(tmp_path / "out"), options, kill_one)
    assert killed
    assert (result.images, result.failed, result.workers) == (40, (), 2)
    assert texts(tmp_path / "out") == WRITTEN


def test_local_cluster(source, tmp_path):
    pytest.importorskip("distributed")
    options = BatchOptions(cluster="local", workers=2, shard_size=7)
    result = run(Reverse(), str(source), str(tmp_path / "out"), options)
    assert (result.written, result.workers) == (40, 2)
    assert texts(tmp_path / "out") == WRITTEN


def test_scheduler_that_does_not_answer_is_reported(source, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("omnisight.pipeline.batch.dask_cluster.TIMEOUT_S", 1)
    options = BatchOptions(cluster="tcp://127.0.0.1:9")
    with pytest.raises(ValueError, match=r"tcp://127.0.0.1:9: no Dask scheduler answers within 1 s"):
        run(Reverse(), str(source), str(tmp_path / "out"), options)


def test_workers_of_another_version_are_reported(source, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("omnisight.__version__", "9.9")
    with pytest.raises(ValueError, match=r"has omnisight .*, this machine 9.9: install the same version"):
        run(Reverse(), str(source), str(tmp_path / "out"), BatchOptions(cluster="local", workers=1))


@pytest.fixture(scope="module")
def bucket():
    """Start an S3 server, and return the URL of a bucket in it and its file system."""
    pytest.importorskip("s3fs")
    server_module = pytest.importorskip("moto.server")
    import fsspec

    server = server_module.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("ACCESS_KEY_ID", "key"), ("SECRET_ACCESS_KEY", "secret"), ("DEFAULT_REGION", "us-east-1")):
            patch.setenv(f"AWS_{name}", value)
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        files = fsspec.filesystem("s3", skip_instance_cache=True)
        files.mkdir("photos")
        yield "s3://photos", files
    server.stop()


def test_bucket_to_bucket_by_local_processes_and_again(bucket):
    url, files = bucket
    for name, data in FILES.items():
        files.pipe_file(f"photos/in/{name}", data)
    options = BatchOptions(workers=2, shard_size=9)
    result = run(Reverse(), f"{url}/in", f"{url}/out", options)
    assert (result.written, result.resumed) == (40, 0)
    files.invalidate_cache()
    found = {name.rsplit("/", 1)[-1]: files.cat_file(name) for name in files.glob("photos/out/*.txt")}
    assert found == WRITTEN
    assert run(Reverse(), f"{url}/in", f"{url}/out", options).resumed == 40


def test_missing_bucket_is_reported(bucket):
    with pytest.raises(ValueError, match="s3://nothing/in"):
        run(Reverse(), "s3://nothing/in", "s3://nothing/out", BatchOptions(workers=1))


def test_a_bucket_without_permission_is_reported(bucket, source, tmp_path, monkeypatch):
    import moto.settings
    from moto.core.authorization import ActionAuthenticatorMixin

    url, files = bucket
    files.pipe_file("photos/private/1.png", b"x")
    monkeypatch.setattr(moto.settings, "INITIAL_NO_AUTH_ACTION_COUNT", 0)
    monkeypatch.setattr(ActionAuthenticatorMixin, "request_count", 0)
    files.invalidate_cache()
    with pytest.raises(ValueError, match=r"s3://photos/private: cannot be listed: .*check the name, and that the cred"):
        run(Reverse(), f"{url}/private", str(tmp_path / "out"), BatchOptions(workers=1))
    with pytest.raises(OSError, match=r"s3://photos/written: cannot be read: .*check the name, and that the cred"):
        run(Reverse(), str(source), f"{url}/written", BatchOptions(workers=1))


def test_both_workers_killed_at_once_lose_nothing(source, tmp_path, scheduler):
    address, workers = scheduler
    killed = []

    def kill_all(stage, done, total):
        if done and not killed:
            killed.extend(workers)
            for worker in killed:
                os.kill(worker.pid, signal.SIGKILL)
            start = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1"]
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
            workers.append(subprocess.Popen(start, cwd=tmp_path, env=environment, stderr=subprocess.DEVNULL))

    options = BatchOptions(cluster=address, shard_size=4)
    result = run(Reverse(seconds=0.05), str(source), str(tmp_path / "out"), options, kill_all)
    assert len(killed) == 2
    assert result.failed == ()
    assert texts(tmp_path / "out") == WRITTEN
