"""Images, folders and the program, for the tests of the command line."""

import shutil
from pathlib import Path

import pytest
from cli_scene import TRUTH

from drawn import POSES, shot
from omnisight import cli
from omnisight.formats import save
from omnisight.images import write_image


@pytest.fixture(scope="session")
def shots(tmp_path_factory):
    """Six images of a board through a fisheye, and the cache that every test of this file shares."""
    folder = tmp_path_factory.mktemp("shots")
    for i, view in enumerate(POSES):
        write_image(folder / f"{i + 1}.png", shot(view)[0])
    return folder


@pytest.fixture(scope="session")
def shared_cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def environment(shared_cache, tmp_path_factory, monkeypatch):
    # Only detections: the cache of compiled code stays shared.
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: shared_cache)
    monkeypatch.chdir(tmp_path_factory.mktemp("work"))
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("NO_COLOR", "1")


@pytest.fixture
def folder(shots, tmp_path):
    """Return a copy of the image folder that a test may modify."""
    return shutil.copytree(shots, tmp_path / "shots")


@pytest.fixture
def camera_file(tmp_path):
    return save(TRUTH, tmp_path / "camera.json").path


@pytest.fixture
def run(capsys):
    """Return a function that runs the command line in this process: exit status, stdout and stderr."""

    work = Path.cwd()

    def command(*arguments):
        (work / "camera.json").unlink(missing_ok=True)  # the default output of `calibrate`, which replaces no file
        status = 0
        try:
            cli.main([str(a) for a in arguments])
        except SystemExit as exit_:
            status = exit_.code or 0
        output = capsys.readouterr()
        assert "Traceback" not in output.out + output.err
        return status, output.out, output.err

    return command


@pytest.fixture
def refuses(run):
    """Return a function that runs an invalid command, checks status 2 and an empty stdout, and returns the message."""

    def command(*arguments):
        status, out, err = run(*arguments)
        assert (status, out) == (2, "")
        assert err.startswith("omnisight: ")
        return err

    return command
