"""The package as a whole: its exports, its imports, its project files, and the code in its documentation."""

import ast
import graphlib
import importlib.metadata
import inspect
import itertools
import os
import pkgutil
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import omnisight as om

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PAGES = ["README.md", *(str(path.relative_to(ROOT)) for path in sorted((ROOT / "docs").rglob("*.md")))]


def code_of(page):
    return re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def run_python(*arguments, **environment):
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=os.environ | environment, capture_output=True, text=True
    )


def test_public_names_are_sorted_and_unique():
    assert list(om.__all__) == sorted(set(om.__all__))


@pytest.mark.parametrize("name", om.__all__)
def test_a_public_name_exists_and_has_its_own_docstring(name):
    value = getattr(om, name)
    assert (inspect.getdoc(value) or "").strip()
    assert value.__doc__, f"{name} only inherits its docstring"


def test_a_submodule_does_not_hide_a_public_name():
    modules = {module.name for module in pkgutil.iter_modules(om.__path__)}
    assert {"calibration", "view_planning"} <= modules
    assert not modules & set(om.__all__)


def test_an_unknown_name_raises_an_attribute_error():
    with pytest.raises(AttributeError, match="nonsense"):
        om.nonsense  # noqa: B018


def test_importing_omnisight_imports_no_slow_package():
    slow = "numpy", "scipy", "numba", "cv2", "av", "rich", "cyclopts"
    done = run_python("-c", f"import sys, omnisight; print(*[name for name in {slow} if name in sys.modules])")
    assert done.stdout.strip() == "", done.stdout + done.stderr
    assert done.returncode == 0


def test_the_version_is_that_of_the_installed_package_and_the_changelog():
    assert om.__version__ == importlib.metadata.version("omnisight")
    assert om.__version__ in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("folder", ["src", "tests", "benchmarks", "examples"])
def test_no_file_has_more_than_350_lines(folder):
    lines = {path: path.read_text(encoding="utf-8").count("\n") for path in (ROOT / folder).rglob("*.py")}
    assert lines
    assert not {str(path.relative_to(ROOT)): count for path, count in lines.items() if count > 350}


def test_no_function_has_more_than_6_positional_parameters():
    """Commands have a parameter for each option; compiled loops take arrays instead of objects."""
    counts = {}
    for path in (ROOT / "src" / "omnisight").rglob("*.py"):
        if path.parent.name == "cli" or path.name.startswith("_"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                names = [argument.arg for argument in node.args.posonlyargs + node.args.args]
                counts[f"{path.name}: {node.name}"] = len([name for name in names if name not in ("self", "cls")])
    assert len(counts) > 1000
    assert not {name: count for name, count in counts.items() if count > 6}


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Return a folder with the cameras and images that `omnisight demo` writes."""
    from omnisight.simulation import fisheye_setup, mirror_setup

    folder = tmp_path_factory.mktemp("pages")
    for name, setup in (("fisheye", fisheye_setup(480)), ("mirror", mirror_setup(360))):
        subfolder = folder / "omnisight-demo" / name
        subfolder.mkdir(parents=True)
        # The calibration with a checkerboard does not know that the camera looks into a mirror.
        om.save(om.flip_frame(setup.camera) if name == "mirror" else setup.camera, subfolder / "camera.json")
        om.write_image(subfolder / "room.jpg", setup.renderer(samples=1)().image)
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
    panorama = om.read_image("panorama.jpg")
    assert panorama.shape[1] == 2048
    assert panorama.std() > 20


def test_the_table_of_the_readme_has_the_results_of_the_pages():
    from benchmarks.summary import summary

    assert len(summary().splitlines()) > 10
    assert summary() in (ROOT / "README.md").read_text(encoding="utf-8"), "insert: python -m benchmarks summary"


@pytest.mark.parametrize("page", PAGES)
def test_the_rows_of_a_table_have_the_cells_of_its_head(page):
    lines = re.sub(r"`[^`\n]*`|\\\|", "", (ROOT / page).read_text(encoding="utf-8")).splitlines()
    for first, second in itertools.pairwise(lines):
        if first.startswith("|") and second.startswith("|"):
            assert first.count("|") == second.count("|"), second


def test_the_links_of_the_readme_are_absolute():
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert links
    assert not [link for link in links if not link.startswith("https://")]
    own = "https://github.com/omnisight/omnisight"
    assert all(link.startswith(own) for link in PROJECT["project"]["urls"].values())
    files = [re.split(r"/(?:blob/)?main/", link)[1] for link in links if "omnisight/omnisight/" in link]
    assert files
    assert not [file for file in files if not (ROOT / file).is_file()]


def test_contributing_lists_the_layers_that_are_checked():
    layers = PROJECT["tool"]["importlinter"]["contracts"][0]["layers"]
    drawing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Layers")[2]
    rows = [line.split() for line in re.findall(r"^    (\w[\w ]*)$", drawing, re.MULTILINE)[: len(layers)]]
    assert rows == [layer.split(" | ") for layer in layers]


def test_no_module_is_part_of_an_import_cycle():
    import grimp  # comes with import-linter, which the benchmark environment lacks

    graph = grimp.build_graph("omnisight", exclude_type_checking_imports=True, cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    assert len(imports) > 100
    assert len(set().union(*imports.values())) > 100
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        pytest.fail("import cycle: " + " <- ".join(error.args[1]))


def test_the_benchmark_environment_has_the_dependencies_of_the_package_with_another_opencv():
    text = (ROOT / "benchmarks" / "requirements.txt").read_text(encoding="utf-8")
    requirements = {line for line in text.splitlines() if line and not line.startswith("#")}
    dependencies = {
        name.replace("opencv-python", "opencv-contrib-python") for name in PROJECT["project"]["dependencies"]
    }
    assert len(dependencies) > 5
    assert dependencies <= requirements
    assert not [name for name in requirements if name.startswith("opencv-python")]
    tests = {
        name for name in PROJECT["project"]["optional-dependencies"]["dev"] if name.startswith(("pytest", "mpmath"))
    }
    assert tests
    assert tests <= requirements


def test_the_camera_model_of_contributing_passes_the_laws(tmp_path):
    (block,) = code_of("CONTRIBUTING.md")
    (tmp_path / "sine.py").write_text(block, encoding="utf-8")
    # In a process of its own, whose model registry and compiled code include the new model.
    laws = (
        "import sys, pytest, omnisight.models as models\n"
        f"models.__path__.append({str(tmp_path)!r})\n"
        "assert 'sine' in models.model_names()\n"
        "laws = [f'tests/models/test_model_{part}.py' for part in ('laws', 'derivatives', 'values')]\n"
        "sys.exit(pytest.main([*laws, '-k', 'sine', '-n0', '-p', 'no:cacheprovider']))\n"
    )
    done = run_python("-c", laws, OMNISIGHT_CACHE=str(tmp_path / "cache"))
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
