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
