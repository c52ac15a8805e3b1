"""Batches: workers, records, and what happens if a process dies."""

import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from batch_tasks import OtherReverse, Reverse, run

from omnisight.camera import Camera
from omnisight.formats import save
from omnisight.images import read_image, write_image
from omnisight.models import model_class
from omnisight.pipeline.batch.batch import Batch
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.batch.local_processes import LocalProcesses
from omnisight.pipeline.batch.manifest import items_of_images, output_names
from omnisight.pipeline.batch.records import shards_of
from omnisight.pipeline.batch.storage import list_images
from omnisight.pipeline.views.view import view
from omnisight.pipeline.views.view_batch import view_batch
from omnisight.pipeline.views.view_options import ViewOptions

ONE, TWO = BatchOptions(workers=1, shard_size=5), BatchOptions(workers=2, shard_size=5)


@pytest.fixture
def source(tmp_path, monkeypatch):
    """Return a folder of 23 files in two sub-folders."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), *sys.path]))
    for i in range(23):
        folder = tmp_path / "images" / f"{i // 12}"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{i:03}.png").write_bytes(f"file {i}".encode())
    return tmp_path / "images"


def outputs(folder):
    """Return the bytes of all outputs by name."""
    files = [file for file in folder.rglob("*") if file.is_file() and ".omnisight" not in file.parts]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def expected(source):
    """Return what the task writes for the files that it does not refuse."""
    files = [file for file in source.rglob("*.png") if not file.name.startswith(("refused", "deadly"))]
    return {str(file.relative_to(source).with_suffix(".txt")): file.read_bytes()[::-1] for file in files}


def test_every_file_has_its_output_and_progress_counts_files(source, tmp_path):
    (source / "0" / "refused.png").write_bytes(b"x")
    (source / ".hidden.png").write_bytes(b"x")
    seen = []
    result = run(Reverse(), str(source), str(tmp_path / "out"), TWO, lambda *event: seen.append(event[1:]))
    written = outputs(tmp_path / "out")
    assert len(written) == 23
    assert written == {name: data for name, data in expected(source).items() if not name.startswith(".")}
    assert (result.images, result.written, result.resumed, result.workers) == (24, 23, 0, 2)
    assert result.failed == ((str(source / "0" / "refused.png"), "refused"),)
    assert seen[0] == (0, 24)
    assert seen[-1] == (24, 24)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_a_second_run_does_nothing_again(source, tmp_path):
    run(Reverse(), str(source), str(tmp_path / "out"), ONE)
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "out").rglob("*.txt")}
    again = run(Reverse(), str(source), str(tmp_path / "out"), ONE)
    assert (again.resumed, again.images, again.written) == (23, 23, 23)
    assert before == {file: file.stat().st_mtime_ns for file in (tmp_path / "out").rglob("*.txt")}


def test_a_shard_without_its_record_is_done_again(source, tmp_path):
    run(Reverse(), str(source), str(tmp_path / "out"), ONE)
    records = sorted((tmp_path / "out" / ".omnisight" / "shards").iterdir())
    assert len(records) == 5
    records[1].unlink()
    records[3].write_text('{"index": 3')
    assert run(Reverse(), str(source), str(tmp_path / "out"), ONE).resumed == 23 - 10
    assert outputs(tmp_path / "out") == expected(source)


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_worker_that_dies_is_replaced_and_nothing_is_lost(source, tmp_path):
    (source / "1" / "once.png").write_bytes(b"once")
    task = Reverse(marker=str(tmp_path / "died"))
    result = run(task, str(source), str(tmp_path / "out"), TWO)
    assert (tmp_path / "died").exists()
    assert result.failed == ()
    assert outputs(tmp_path / "out") == expected(source)


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_images_that_kill_every_worker_are_reported_and_the_others_written(source, tmp_path):
    (source / "0" / "deadly.png").write_bytes(b"x")
    result = run(Reverse(), str(source), str(tmp_path / "out"), ONE)
    reasons = dict(result.failed)
    assert str(source / "0" / "deadly.png") in reasons
    assert 1 <= len(reasons) <= 5  # at most its shard
    assert "died 3 times" in reasons[str(source / "0" / "deadly.png")]
    (source / "0" / "deadly.png").write_bytes(b"y")
    retried = run(Reverse(), str(source), str(tmp_path / "out"), ONE)
    assert retried.resumed == 24 - len(reasons)  # what failed in this way is tried again


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_killed_run_continues(source, tmp_path):
    out = tmp_path / "out"
    code = (
        "import sys; from batch_tasks import Reverse, run\n"
        "from omnisight.pipeline.batch.batch_options import BatchOptions\n"
        "options = BatchOptions(workers=1, shard_size=5)\n"
        "if __name__ == '__main__': run(Reverse(seconds=0.2), *sys.argv[1:], options)\n"
    )
    (tmp_path / "client.py").write_text(code)
    command = [sys.executable, str(tmp_path / "client.py"), str(source), str(out)]
    with subprocess.Popen(command, start_new_session=True) as client:
        shards = out / ".omnisight" / "shards"
        while not (shards.is_dir() and len(list(shards.glob("*.json"))) >= 2):
            assert client.poll() is None, "the run ended before it could be killed"
            time.sleep(0.02)
        os.killpg(client.pid, signal.SIGKILL)
    result = run(Reverse(), str(source), str(out), ONE)
    assert 10 <= result.resumed < 23
    assert outputs(out) == expected(source)


def test_a_full_disk_is_reported_and_the_run_continues(source, tmp_path):
    blocking = tmp_path / "out" / "1" / "015.txt"
    blocking.mkdir(parents=True)  # a file cannot replace a folder, nor be written to a full disk
    with pytest.raises(OSError, match=r"cannot write .*015.txt: .*: resolve it, and the same command continues"):
        run(Reverse(), str(source), str(tmp_path / "out"), ONE)
    blocking.rmdir()
    assert run(Reverse(), str(source), str(tmp_path / "out"), ONE).resumed >= 15
    assert outputs(tmp_path / "out") == expected(source)


def test_a_file_that_cannot_be_read_is_tried_again(source, tmp_path):
    late = str(source / "0" / "late.png")
    items = items_of_images({**list_images(str(source), "out"), late: "1"}, ".txt")
    batch, arguments = Batch(str(tmp_path / "out"), ONE), (Reverse(), items, str(source))
    first = batch.run(*arguments)
    assert [(path, reason.split(":")[0]) for path, reason in first.failed] == [(late, "cannot be read")]
    (source / "0" / "late.png").write_bytes(b"late")
    again = batch.run(*arguments)
    assert (again.failed, again.resumed) == ((), 23)
    assert outputs(tmp_path / "out") == expected(source)


def test_images_that_were_replaced_are_processed_again_and_no_others(source, tmp_path):
    out = tmp_path / "out"
    (source / "0" / "refused.png").write_bytes(b"x")
    assert len(run(Reverse(), str(source), str(out), ONE).failed) == 1
    before = {file: file.stat().st_mtime_ns for file in out.rglob("*.txt")}
    (source / "1" / "015.png").write_bytes(b"another file")
    os.utime(source / "1" / "020.png", (0, 0))  # as after a copy
    result = run(Reverse(), str(source), str(out), ONE)
    assert (result.resumed, result.written, len(result.failed)) == (22, 23, 1)
    after = {file: file.stat().st_mtime_ns for file in out.rglob("*.txt")}
    assert {file.name for file in after if after[file] != before[file]} == {"015.txt", "020.txt"}
    assert outputs(out)["1/015.txt"] == b"elif rehtona"
    assert run(Reverse(), str(source), str(out), ONE).resumed == 24


def test_an_image_that_failed_is_tried_again_once_it_is_replaced_and_the_reverse(tmp_path):
    source, out = tmp_path / "images", tmp_path / "out"
    source.mkdir()
    for i in range(3):
        write_image(source / f"{i}.png", np.full((8, 8), 40 * i, np.uint8))
    camera = Camera(model_class("equidistant")(5.0, 5.0, 3.5, 3.5), (8, 8), theta_max=0.6)
    whole = (source / "1.png").read_bytes()
    (source / "1.png").write_bytes(whole[:30])

    def run_again():
        result = view_batch(str(source), camera, Batch(str(out), ONE), ViewOptions(size=(4, 4)))
        written = sorted(file.stem for file in out.glob("*.png"))
        assert sorted([Path(name).stem for name, _ in result.failed] + written) == ["0", "1", "2"]
        return result.resumed, written

    assert run_again() == (0, ["0", "2"])
    assert run_again() == (3, ["0", "2"])
    (source / "1.png").write_bytes(whole)
    assert run_again() == (2, ["0", "1", "2"])
    (source / "2.png").write_bytes(b"no image")
    assert run_again() == (2, ["0", "1"])


def test_shards_are_so_small_that_each_worker_has_several():
    items = items_of_images({f"/{i}.png": "" for i in range(1000)}, ".txt")
    for workers, size, count in ((1, 100, 10), (8, 31, 33), (1000, 1, 1000)):
        shards = shards_of(items, 7, None, workers)
        assert [len(shard.items) for shard in shards[:-1]] == [size] * (count - 1)
        assert [shard.index for shard in shards] == list(range(7, 7 + count))
        assert [item for shard in shards for item in shard.items] == items
    assert len(shards_of(items, 0, 300, 8)) == 4


def test_another_task_or_other_images_are_refused(source, tmp_path):
    out = str(tmp_path / "out")
    run(Reverse(), str(source), out, ONE)
    with pytest.raises(ValueError, match=r"another version \(1, now 2\): choose another output, or delete"):
        run(OtherReverse(), str(source), out, ONE)
    (source / "0" / "new.png").write_bytes(b"x")
    with pytest.raises(ValueError, match=r"other images of .* \(1 new, 0 missing\)"):
        run(Reverse(), str(source), out, ONE)


def test_workers_with_another_working_directory_have_the_same_files(source, tmp_path, monkeypatch):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    class Elsewhere(LocalProcesses):
        def run(self, work, arguments, shards):
            monkeypatch.chdir(elsewhere)
            return super().run(work, arguments, shards)

    monkeypatch.setattr("omnisight.pipeline.batch.batch.LocalProcesses", Elsewhere)
    monkeypatch.chdir(tmp_path)
    result = run(Reverse(), "images", "out", ONE)
    assert (result.written, result.failed) == (23, ())
    assert outputs(tmp_path / "out") == expected(source)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"task": [], "source": "", "items": []}',
        '{"task": {"options": 3}, "source": "", "items": []}',
        '{"task": {}, "source": 3, "items": []}',
        '{"task": {}, "source": "", "items": 3}',
        '{"task": {}, "source": "", "items": [[1, 2, 3]]}',
        '{"task": {}, "source": "", "items": [[[["a"]], ["b"], 0]]}',
        '{"task": {}, "source": "", "items": [[[], [], 0]]}',
        '{"task": {}, "source": "", "items": [], "more": 1}',
        "[" * 100_000,
        b"\xff\xfe\xfd",
    ],
)
def test_a_damaged_manifest_is_named(source, tmp_path, text):
    path = tmp_path / "out" / ".omnisight" / "manifest.json"
    path.parent.mkdir(parents=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ValueError, match=r"manifest\.json: is not a manifest \(.*delete the folder"):
        run(Reverse(), str(source), str(tmp_path / "out"), ONE)


@pytest.mark.parametrize(
    ("source", "output", "message"),
    [
        ("none", "out", "none: no such file or folder"),
        (".", "./out", "is in the folder of the images"),
        ("nonsense://bucket/images", "out", "nonsense://bucket/images"),
    ],
)
def test_unusable_folders_are_reported(source, output, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=message):
        run(Reverse(), source, output, ONE)


@pytest.mark.parametrize("pattern", ["images/0/*.png", "images/0/000.png", "images/**", "link"])
def test_images_are_never_overwritten(source, tmp_path, pattern):
    before, output = outputs(source), str(source if pattern == "images/**" else source / "0")
    if pattern == "link":
        (tmp_path / "link").symlink_to(source / "0", target_is_directory=True)
    images = str(tmp_path / pattern)
    with pytest.raises(ValueError, match=r"is one of the inputs|is in the folder of the images"):
        Batch(output, ONE).run(Reverse(), items_of_images(list_images(images, output), ".png"), images)
    assert outputs(source) == before


@pytest.mark.parametrize(
    ("cluster", "message"), [("localhost", "--cluster must be local or the address of a Dask scheduler")]
)
def test_invalid_options_are_reported(cluster, message):
    with pytest.raises(ValueError, match=message):
        BatchOptions(cluster=cluster)


def test_outputs_are_unique():
    assert output_names(["/a/x/1.png", "/a/y/1.png"], ".png") == ["x/1.png", "y/1.png"]
    assert output_names(["/a/1.jpg", "/a/1.PNG", "/a/2.png"], ".png") == ["1_jpg.png", "1_PNG.png", "2.png"]


def test_views_equal_those_of_the_plain_command_also_from_an_archive(tmp_path):
    camera = Camera(model_class("equidistant")(60.0, 60.0, 63.5, 47.5), (128, 96), theta_max=1.4)
    rng = np.random.default_rng(0)
    (tmp_path / "images").mkdir()
    for i in range(3):
        write_image(tmp_path / "images" / f"{i}.png", rng.integers(0, 256, (96, 128, 3), np.uint8))
    options = ViewOptions(size=(64, 48), yaw=20.0)
    view([tmp_path / "images"], camera, tmp_path / "plain", options)
    stored = save(camera, tmp_path / "c.json").path
    view_batch(str(tmp_path / "images"), stored, Batch(str(tmp_path / "batch"), TWO), options)
    with zipfile.ZipFile(tmp_path / "images.zip", "w") as archive:
        for file in (tmp_path / "images").iterdir():
            archive.write(file, f"inside/{file.name}")
    view_batch(f"zip://inside/*::{tmp_path / 'images.zip'}", camera, Batch(str(tmp_path / "archive"), ONE), options)
    plain = outputs(tmp_path / "plain")
    assert len(plain) == 3
    assert outputs(tmp_path / "batch") == plain
    assert outputs(tmp_path / "archive") == plain
    assert read_image(tmp_path / "batch" / "0.png").shape == (48, 64, 3)
    record = json.loads((tmp_path / "batch" / ".omnisight" / "shards" / "0000000.json").read_text())
    assert (len(record["finished"]), record["failed"]) == (3, {})
