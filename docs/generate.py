"""The hook that fills the documentation from the code, so that nothing is listed by hand.

A line `{{ name argument | argument }}` of a page is replaced by what the function of that name here gives.
"""

import importlib
import inspect
import itertools
import pkgutil
import re
import tempfile
from pathlib import Path
from typing import Any

import omnisight as om

ROOT = Path(__file__).resolve().parent.parent
PRESENT: set[str] = set()
MARK = re.compile(r"^\{\{ *(\w+) *(.*?) *\}\}$", re.MULTILINE)


def on_files(files: Any, config: Any) -> Any:
    """Add the images that are drawn at every build."""
    from mkdocs.structure.files import File

    for name, content in {**curves(), **view_pictures()}.items():
        files.append(File.generated(config, name, content=content))
    PRESENT.update(file.src_uri for file in files)
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Fill the marks of a page."""
    up = "../" * page.file.src_uri.count("/")

    def fill(mark: re.Match[str]) -> str:
        arguments = [part.strip() for part in mark[2].split("|")] if mark[2] else []
        return MARKS[mark[1]](*arguments).replace("](@/", f"]({up}")

    return MARK.sub(fill, markdown)


def models() -> str:
    """Give one section per camera model."""
    return "\n".join(_model(name) for name in om.model_names())


def _model(name: str) -> str:
    cls = om.model_class(name)
    example = cls.example()
    lines = [f"## {name}", "", *_prose(inspect.getdoc(cls) or "")]
    lines += ["| parameter | what it is | unit | bounds | estimated |", "|---|---|---|---|---|"]
    # Coefficients of one kind share a row.
    for (_, doc), alike in itertools.groupby(example.parameters, key=lambda p: (p.name.rstrip("0123456789"), p.doc)):
        p, *rest = alike
        bounds = f"{_bound(p.low)} to {_bound(p.high)}" if p.low > -float("inf") or p.high < float("inf") else ""
        named = f"`{p.name}`" + (f" ... `{rest[-1].name}`" if rest else "")
        lines.append(f"| {named} | {_plain(doc)} | {p.unit} | {bounds} | {'yes' if p.free else 'on request'} |")
    held = [f"`{key}`" for key in _formats() if name in _formats()[key].MODELS]
    lines += ["", f"Held by the formats {', '.join(held)}."]
    if _is_central(cls):
        lines += ["", f"![r(theta) of the example of {name}](@/assets/models/{name}.svg){{ width=420 }}"]
    return "\n".join([*lines, ""])


def ray_models() -> str:
    """Give one section per non-central camera that can be calibrated."""
    from omnisight.optics.models import ray_model_class, ray_model_names

    sections: list[str] = []
    for name in ray_model_names():
        cls = ray_model_class(name)
        own = [p for p in cls.example().parameters if p.unit != "px" and p.unit]
        rows = [f"| `{p.name}` | {_plain(p.doc)} | {p.unit} |" for p in own]
        prose = _prose((inspect.getdoc(cls) or "").partition("\n\nAttributes\n")[0])
        sections += [f"### {name}", "", *prose, "| parameter | what it is | unit |", "|---|---|---|", *rows, ""]
    return "\n".join(sections)


def formats() -> str:
    """Give the table of formats."""
    lines = ["| `--to` | what it is | file | models, the most usual first |", "|---|---|---|---|"]
    for key, value in _formats().items():
        held = "every model" if set(value.MODELS) == set(om.model_names()) else ", ".join(value.MODELS)
        lines.append(f"| `{key}` | {_plain(value.TITLE)} | `{value.SUFFIX}` | {held} |")
    return "\n".join(lines)


def conventions() -> str:
    """Give what each format means by its numbers."""
    lines = ["| format | its convention |", "|---|---|"]
    lines += [f"| {_plain(value.TITLE)} | {_plain(value.CONVENTION)} |" for value in _formats().values()]
    return "\n".join(lines)


def corner_formats() -> str:
    """Give the table of formats of corners."""
    from omnisight.corners import get_corner_format, corner_format_names

    lines = ["| | file | its convention |", "|---|---|---|"]
    for value in map(get_corner_format, corner_format_names()):
        lines.append(f"| {_plain(value.TITLE)} | `{value.SUFFIX}` | {_plain(value.CONVENTION)} |")
    return "\n".join(lines)


def matrix() -> str:
    """Give which format holds which model exactly."""
    found = _formats()
    lines = ["| | " + " | ".join(found) + " |", "|---" * (len(found) + 1) + "|"]
    for name in om.model_names():
        ticks = " | ".join("●" if name in value.MODELS else "" for value in found.values())
        lines.append(f"| [{name}](@/reference/models.md#{name}) | {ticks} |")
    return "\n".join(lines)


def candidates() -> str:
    """Give the models that `--model auto` fits."""
    from omnisight.calibration.model_selection import AUTO, NARROW_AUTO

    def linked(names: tuple[str, ...]) -> str:
        return ", ".join(f"[{name}](@/reference/models.md#{name})" for name in names)

    return f"{linked(AUTO)}; for a narrow lens also {linked(NARROW_AUTO)}."


def commands() -> str:
    """Give the command line's own help, command by command."""
    from cyclopts import App

    from omnisight import cli

    app = App(name="omnisight", help_flags=(), version_flags=(), help_format="markdown")
    for found in pkgutil.iter_modules(cli.__path__):
        if not found.name.startswith("_"):
            app.command(
                getattr(importlib.import_module(f"omnisight.cli.{found.name}"), found.name),
                name=found.name.replace("_", "-"),
            )
    text = app.generate_docs(output_format="markdown")
    return text[text.index("## omnisight ") :]


def examples() -> str:
    """Give every example with its code."""
    sections: list[str] = []
    for path in sorted((ROOT / "examples").glob("[0-9]*.py")):
        text = path.read_text()
        title = path.stem.partition("_")[2].replace("_", " ").capitalize()
        lead = inspect.cleandoc(text.split('"""')[1]).splitlines()[0]
        sections.append(f'## {title}\n\n{_plain(lead)}\n\n```python title="examples/{path.name}"\n{text.strip()}\n```')
    return "\n\n".join(sections)


def api() -> str:
    """Give every public name, by the module it lives in."""
    pages: list[str] = []
    for module, names in om._HOME.items():
        pages += [f"## omnisight.{module}", ""]
        pages += [f"::: omnisight.{module}.{name}" for name in sorted(names)]
    return "\n\n".join(pages)


def members(module: str) -> str:
    """Give the public classes and functions of a module."""
    found = importlib.import_module(module)
    own = [name for name, value in vars(found).items() if getattr(value, "__module__", "") == module]
    names = [name for name in getattr(found, "__all__", own) if name[0] != "_" and callable(getattr(found, name))]
    return "\n\n".join(f"::: {module}.{name}" for name in names)


def picture(path: str, said: str) -> str:
    """Show an image of docs/, if it has been drawn, with what it shows below it."""
    return f"![{said}](@/{path})\n*{said}*" if path in PRESENT else ""


def file(name: str, instead: str = "") -> str:
    """Give a file of the repository without its title; `instead` where there is none."""
    path = ROOT / name
    return path.read_text().partition("\n")[2] if path.exists() else instead


MARKS = {
    function.__name__: function
    for function in (
        *(models, ray_models, formats, corner_formats, conventions, matrix, candidates, commands),
        *(examples, api, members, picture, file),
    )
}


def curves() -> dict[str, str]:
    """Draw r(theta) of the example of every camera with an axis."""
    from omnisight.report.drawings.radial_profile import radial_profile, profile_svg

    drawn: dict[str, str] = {}
    for name in om.model_names():
        cls = om.model_class(name)
        if _is_central(cls):
            example = cls.example()
            middle, _ = example.project([0.0, 0.0, 1.0])
            camera = om.Camera(example, (round(2 * middle[0]), round(2 * middle[1])))
            drawn[f"assets/models/{name}.svg"] = profile_svg(radial_profile(camera))
    return drawn


def view_pictures() -> dict[str, bytes]:
    """Draw every kind of view of a rendered room."""
    from omnisight.simulation import fisheye_setup, mirror_setup
    from omnisight.views.cube import CUBE_FACES, cube_rotation

    fisheye, mirror = fisheye_setup(), mirror_setup()
    lens, room = fisheye.camera, fisheye.renderer()().image
    bowl, bowl_room = mirror.camera, mirror.renderer()().image
    level, upright = om.look(pitch=8), om.look(up="back")
    drawn: dict[str, Any] = {"fisheye_image": room, "mirror_image": bowl_room}
    for name, target in {
        "perspective": om.perspective(100, (640, 400)),
        "panini": om.panini(165, (640, 360)),
        "sphere": om.sphere(720),
        "fisheye": om.fisheye(400, 180, "equisolid"),
    }.items():
        drawn[name] = om.remap(room, lens, target, level, interpolation="bicubic")
    for name, target, rotation in (
        ("cylinder", om.cylinder(960, (-50, 18)), upright),
        ("mercator", om.mercator(960, (-50, 18)), upright),
        ("planet", om.planet(400, 215), om.look(pitch=-90, up="back")),
        ("wrong_flip", om.cylinder(960, (-50, 18)), om.look(up="back", flip=True)),
    ):
        drawn[name] = om.remap(bowl_room, bowl, target, rotation, interpolation="bicubic")
    for face in CUBE_FACES:
        drawn[f"cube_{face}"] = om.remap(room, lens, om.cube_face(200), cube_rotation(face, level))
    with tempfile.TemporaryDirectory() as folder:
        pictures: dict[str, bytes] = {}
        for name, image in drawn.items():
            path = Path(folder) / f"{name}.jpg"
            om.write_image(path, image)
            pictures[f"assets/views/{name}.jpg"] = path.read_bytes()
    return pictures


def _formats() -> dict[str, Any]:
    from omnisight.formats import get_format, format_names

    return {name: get_format(name) for name in format_names()}


def _is_central(cls: type) -> bool:
    from omnisight.models._profile_camera import ProfileCamera

    return issubclass(cls, ProfileCamera)


def _prose(text: str) -> list[str]:
    """Give a docstring as Markdown: paragraphs that are formulas as code, the rest as they are."""
    lines: list[str] = []
    for paragraph in text.split("\n\n"):
        formula = "=" in paragraph and not paragraph.rstrip().endswith(".")
        lines += ["```text", paragraph, "```", ""] if formula else [_plain(" ".join(paragraph.split())), ""]
    return lines


def _plain(text: str) -> str:
    """Keep formulas in running text from being read as Markdown."""
    return re.sub(r"([*_|\[\]`])", r"\\\1", text).replace("<", "&lt;")


def _bound(value: float) -> str:
    return "-∞" if value == -float("inf") else "∞" if value == float("inf") else f"{value:g}"
