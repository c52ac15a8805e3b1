"""The package as a whole: what it exports, how it starts, and that what is written about it holds."""

import importlib.metadata
import inspect
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import omnisight as om
from omnisight.formats import format_named, format_names

ROOT = Path(__file__).resolve().parent.parent
PAGES = ["README.md", *(str(path.relative_to(ROOT)) for path in sorted((ROOT / "docs").rglob("*.md")))]


def code_of(page):
    return re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def run_python(*arguments, **environment):
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=os.environ | environment, capture_output=True, text=True
    )


def test_all_is_sorted():
    assert list(om.__all__) == sorted(set(om.__all__))


@pytest.mark.parametrize("name", om.__all__)
def test_a_public_name_exists_and_says_what_it_is(name):
    value = getattr(om, name)
    assert (inspect.getdoc(value) or "").strip()
    assert value.__doc__, f"{name} only inherits its docstring"


def test_an_unknown_name_is_no_attribute():
    with pytest.raises(AttributeError, match="nonsense"):
        om.nonsense  # noqa: B018


def test_importing_it_imports_nothing_slow():
    slow = "numpy", "scipy", "numba", "cv2", "rich", "cyclopts"
    done = run_python("-c", f"import sys, omnisight; print(*[name for name in {slow} if name in sys.modules])")
    assert done.stdout.strip() == "", done.stdout + done.stderr
    assert done.returncode == 0


def test_the_version_is_that_of_the_package():
    assert om.__version__ == importlib.metadata.version("omnisight")
    assert om.__version__ in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("folder", ["src", "tests", "benchmarks", "examples"])
def test_no_file_is_long(folder):
    lines = {path: path.read_text(encoding="utf-8").count("\n") for path in (ROOT / folder).rglob("*.py")}
    assert lines
    assert not {str(path.relative_to(ROOT)): count for path, count in lines.items() if count > 350}


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Give a folder with cameras and images where `omnisight demo` leaves them."""
    from omnisight.simulation import fisheye_setup, mirror_setup

    folder = tmp_path_factory.mktemp("pages")
    for name, setup in (("fisheye", fisheye_setup(480)), ("mirror", mirror_setup(360))):
        place = folder / "omnisight-demo" / name
        place.mkdir(parents=True)
        om.save(setup.camera, place / "camera.json")
        om.write_image(place / "room.jpg", setup.renderer(samples=1)().image)
    return folder


@pytest.mark.parametrize("page", [page for page in PAGES[1:] if code_of(page)])
def test_the_code_of_a_page_runs(page, demo, monkeypatch):
    monkeypatch.chdir(demo)
    names = {}
    for block in code_of(page):
        exec(compile(block, page, "exec"), names)


def test_the_code_of_the_readme_makes_a_panorama(demo, monkeypatch):
    monkeypatch.chdir(demo)
    (block,) = code_of("README.md")
    assert len([line for line in block.splitlines() if line and not line.startswith("import")]) <= 6
    exec(compile(block, "README.md", "exec"), {})
    picture = om.read_image("panorama.jpg")
    assert picture.shape[1] == 2048
    assert picture.std() > 20


def test_the_readme_names_every_format():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert not [name for name in format_names() if format_named(name).TITLE.split()[0] not in readme]


def test_contributing_draws_the_floors_as_they_are_checked():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = project["tool"]["importlinter"]["contracts"][0]["layers"]
    drawn = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Floors")[2]
    found = [line.split() for line in re.findall(r"^    (\w[\w ]*)$", drawn, re.MULTILINE)[: len(layers)]]
    assert found == [layer.replace("omnisight.", "").split(" | ") for layer in layers]


def test_the_camera_model_of_contributing_passes_the_laws(tmp_path):
    (block,) = code_of("CONTRIBUTING.md")
    (tmp_path / "sine.py").write_text(block, encoding="utf-8")
    # In a process of its own: the registry and the compiled code of this one know nothing of it.
    laws = (
        "import sys, pytest, omnisight.models as models\n"
        f"models.__path__.append({str(tmp_path)!r})\n"
        "assert 'sine' in models.model_names()\n"
        "laws = [f'tests/models/test_model_{part}.py' for part in ('laws', 'derivatives', 'values')]\n"
        "sys.exit(pytest.main([*laws, '-k', 'sine', '-n0', '-p', 'no:cacheprovider']))\n"
    )
    done = run_python("-c", laws, OMNISIGHT_CACHE=str(tmp_path / "cache"))
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
