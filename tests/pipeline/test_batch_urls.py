"""Batches of relative URLs and of archives."""

import os
import sys
import zipfile
from pathlib import Path

import pytest
from batch_tasks import Reverse, run

from omnisight.pipeline.batch import storage
from omnisight.pipeline.batch.batch import Batch
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.batch.storage import file_system, list_images, read_file
from omnisight.pipeline.stitching.stitch_batch import stitch_batch

ONE = BatchOptions(workers=1)


@pytest.fixture(autouse=True)
def workers_find_the_tasks(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), *sys.path]))


@pytest.mark.parametrize(
    "images", ["images", "./images/*/*.png", "zip://*.png::images.zip", "zip://::file://images.zip"]
)
def test_relative_urls_are_those_of_the_current_working_directory(tmp_path, monkeypatch, images):
    for name in ("one", "two"):
        (tmp_path / name / "images" / "0").mkdir(parents=True)
        (tmp_path / name / "images" / "0" / "a.png").write_bytes(name.encode())
        with zipfile.ZipFile(tmp_path / name / "images.zip", "w") as archive:
            archive.write(tmp_path / name / "images" / "0" / "a.png", "a.png")
    for name in ("one", "two"):
        monkeypatch.chdir(tmp_path / name)
        assert run(Reverse(), images, "out", ONE).resumed == 0
        assert (tmp_path / name / "out" / "a.txt").read_bytes() == name[::-1].encode()


def test_another_archive_is_refused_and_the_same_one_by_another_path_continues(tmp_path, monkeypatch):
    for name in ("a", "b"):
        with zipfile.ZipFile(tmp_path / f"{name}.zip", "w") as archive:
            archive.writestr("1.png", "the same image")
    monkeypatch.chdir(tmp_path)
    out, (first, other) = str(tmp_path / "out"), (f"zip://*.png::{tmp_path / name}.zip" for name in ("a", "b"))
    assert run(Reverse(), first, out, ONE).resumed == 0
    for source in (other, "zip://*.png::b.zip", "zip://::file://b.zip", "simplecache::zip://*.png::b.zip"):
        with pytest.raises(ValueError, match=r"holds a run over images of .*a\.zip, not of .*b\.zip: choose another"):
            run(Reverse(), source, out, ONE)
    (tmp_path / "link.zip").symlink_to(tmp_path / "a.zip")
    for source in (
        "zip://*.png::a.zip",
        "zip://1.png::file://a.zip",
        f"zip://::{tmp_path}/../{tmp_path.name}/link.zip",
    ):
        assert run(Reverse(), source, out, ONE).resumed == 1


@pytest.mark.parametrize(
    ("a", "b", "is_same"),
    [
        ("s3://bucket/a/*.jpg", "s3://bucket/b", True),
        ("s3://bucket/a", "gs://bucket/a", False),
        ("simplecache::s3://bucket/*.jpg", "s3://bucket/?.jpg", True),
        ("zip://*.jpg::s3://bucket/a.zip", "zip://::simplecache::s3://bucket/a.zip", True),
        ("zip://*.jpg::s3://bucket/a.zip", "zip://*.jpg::s3://bucket/b.zip", False),
        ("zip://*.jpg::s3://bucket/a.zip", "zip://*.jpg::/bucket/a.zip", False),
        ("zip://*::zip://a.zip::/x.zip", "zip://*::zip://b.zip::/x.zip", False),
        ("zip://*::/x.tar", "tar://*::/x.tar", False),
        ("images", "file:///elsewhere", True),
        ("images", "local:///elsewhere", True),
        ("gs://bucket/a", "gcs://bucket/b", True),
        ("s3a://bucket/a", "simplecache::s3://bucket/b", True),
        ("az://bucket/a", "s3://bucket/b", False),
        ("zip://*::gs://bucket/a.zip", "zip://*::gcs://bucket/a.zip", True),
        ("zip://*::gs://bucket/a.zip", "zip://*::gcs://bucket/b.zip", False),
    ],
)
def test_file_systems_differ_by_protocol_and_archive(a, b, is_same):
    assert (file_system(a) == file_system(b)) is is_same


def test_images_of_cameras_in_different_archives_are_refused_before_they_are_read(tmp_path):
    sources = [f"zip://*::{tmp_path / name}.zip" for name in ("front", "back")]
    with pytest.raises(ValueError, match=r"front\.zip and .*back\.zip are in different archives or storages.*extract"):
        stitch_batch(sources, Batch(str(tmp_path / "out"), ONE))


@pytest.mark.parametrize("archive", ["images.zip", "file://images.zip"])
def test_a_rewritten_archive_is_read_again(tmp_path, monkeypatch, archive):
    monkeypatch.chdir(tmp_path)
    for names in (["a.png"], ["a.png", "b.png"]):
        with zipfile.ZipFile(tmp_path / "images.zip", "w") as file:
            for name in names:
                file.writestr(name, f"{name} of {len(names)}")
        assert list(list_images(f"zip://*.png::{archive}", str(tmp_path / "out"))) == names
        assert read_file(f"zip://*.png::{archive}", names[-1]) == f"{names[-1]} of {len(names)}".encode()


def test_a_damaged_archive_is_refused_by_its_name(tmp_path):
    (tmp_path / "images.zip").write_bytes(b"no archive")
    with pytest.raises(OSError, match=r"images\.zip: cannot be opened: File is not a zip file"):
        list_images(f"zip://*.png::{tmp_path / 'images.zip'}", str(tmp_path / "out"))


def test_an_object_store_without_credentials_is_reported_with_what_to_do(tmp_path, monkeypatch):
    pytest.importorskip("s3fs").S3FileSystem.clear_instance_cache()
    storage._opened.cache_clear()
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    with pytest.raises(ValueError, match=r"s3://bucket/images: cannot be listed: Unable to locate credentials .*check"):
        list_images("s3://bucket/images", str(tmp_path / "out"))
