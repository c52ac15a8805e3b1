"""Fixtures that several test files share."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def data():
    """Give the folder of a set of real pictures by its name; the test skips where the set is not there."""
    base = ROOT / os.environ.get("OMNISIGHT_DATA", "../shared/data")

    def folder(name):
        path = base / name
        if not path.exists():
            pytest.skip(f"needs {name} in {base}; OMNISIGHT_DATA says where")
        return path

    return folder


@pytest.fixture
def get(tmp_path):
    """Give a function that reads the camera of a calibration file's text."""
    from omnisight.formats import load

    def camera(text):
        (tmp_path / "file").write_text(text)
        return load(tmp_path / "file")

    return camera
