"""Fixtures of several test files, and the settings of every test process."""

import os

# The processes of the tests share the cores already. More threads for small matrices and images double the processor
# time. Both variables are read when numpy and OpenCV are imported, and subprocesses inherit them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
os.environ["LC_ALL"] = "C.UTF-8"  # the locale decides between A4 and Letter

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from browser import find_browser
from compiling import STEPS, compile_step

ROOT = Path(__file__).resolve().parent.parent


def pytest_xdist_auto_num_workers(config):
    """Run folders in one process per core, and single files in this process, which starts sooner."""
    return None if any(Path(argument).is_dir() for argument in config.args) else 0


def pytest_xdist_setupnodes(config, specs):
    """Compile everything once before the workers start: otherwise each compiles what it needs, often the same."""
    if config.args == config.getini("testpaths"):
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(len(specs), mp_context=spawn) as pool:
            list(pool.map(compile_step, STEPS))


@pytest.fixture
def data():
    """Return a function from the name of a data set of real images to its folder; skip the test without the set."""
    base = ROOT / os.environ.get("OMNISIGHT_DATA", "../shared/data")

    def folder(name):
        path = base / name
        if not path.exists():
            pytest.skip(f"needs {name} in {base}; the variable OMNISIGHT_DATA names that folder")
        return path

    return folder


@pytest.fixture
def fresh_detections(tmp_path_factory, monkeypatch):
    """Cache detections for this run only, shared by its processes: another version may detect other corners."""
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    monkeypatch.setattr("omnisight.targets.cache.cache_folder", lambda: folder / "detections")


@pytest.fixture
def load_text(tmp_path):
    """Return a function that reads the camera of a calibration file with the given text."""
    from omnisight.formats import load

    def camera(text):
        (tmp_path / "file").write_text(text)
        return load(tmp_path / "file")

    return camera


@pytest.fixture(scope="session")
def browser():
    """Return a browser; skip the test if there is none."""
    path = find_browser()
    if path is None:
        pytest.skip("needs a browser: Chromium or Chrome on the path, or OMNISIGHT_BROWSER=/path/to/one")
    from playwright.sync_api import sync_playwright

    quiet = ["--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"]
    with sync_playwright() as playwright:
        # WebGL runs on the processor.
        software = ["--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=path, args=[*quiet, "--disable-sync", *software])
        yield browser
        browser.close()
