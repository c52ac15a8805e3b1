"""Images, folders and the program, for the tests of the command line."""

import shutil

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
def environment(shared_cache, monkeypatch):
    # Detections alone: what is compiled stays where it is.
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: shared_cache)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("NO_COLOR", "1")


@pytest.fixture
def folder(shots, tmp_path):
    """Give a folder of the images that a test may spoil."""
    return shutil.copytree(shots, tmp_path / "shots")


@pytest.fixture
def camera_file(tmp_path):
    return save(TRUTH, tmp_path / "camera.json").path


@pytest.fixture
def run(capsys):
    """Run the command line in this process; give exit status, stdout and stderr."""

    def command(*arguments):
        status = 0
        try:
            cli.main([str(a) for a in arguments])
        except SystemExit as left:
            status = left.code or 0
        said = capsys.readouterr()
        assert "Traceback" not in said.out + said.err
        return status, said.out, said.err

    return command


@pytest.fixture
def refuses(run):
    """Run what must be refused: status 2, nothing on stdout, one message; give the message."""

    def command(*arguments):
        status, out, err = run(*arguments)
        assert (status, out) == (2, "")
        assert err.startswith("omnisight: ")
        return err

    return command
