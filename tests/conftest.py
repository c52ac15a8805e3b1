"""Fixtures that several test files share."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def pytest_xdist_auto_num_workers(config):
    """Share a folder out among processes; a file that is named has begun before they would have."""
    return None if any(Path(argument).is_dir() for argument in config.args) else 0


@pytest.fixture
def data():
    """Give the folder of a set of real images by its name; the test skips where the set is not there."""
    base = ROOT / os.environ.get("OMNISIGHT_DATA", "../shared/data")

    def folder(name):
        path = base / name
        if not path.exists():
            pytest.skip(f"needs {name} in {base}; OMNISIGHT_DATA says where")
        return path

    return folder


@pytest.fixture
def fresh_detections(tmp_path_factory, monkeypatch):
    """Keep what is found in images for this run alone, in all of its processes: another may find otherwise."""
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: folder / "found")


@pytest.fixture
def get(tmp_path):
    """Give a function that reads the camera of a calibration file's text."""
    from omnisight.formats import load

    def camera(text):
        (tmp_path / "file").write_text(text)
        return load(tmp_path / "file")

    return camera
