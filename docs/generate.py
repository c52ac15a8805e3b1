"""MkDocs hook that generates parts of the pages from the code.

A line `{{ name argument | argument }}` of a page is replaced by the return value of the function of that name below.
"""

import importlib
import inspect
import itertools
import math
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import omnisight as om

ROOT = Path(__file__).resolve().parent.parent
PRESENT: set[str] = set()
MARK = re.compile(r"^\{\{ *(\w+) *(.*?) *\}\}$", re.MULTILINE)


def on_files(files: Any, config: Any) -> Any:
    """Add the images that are drawn in every build."""
    from mkdocs.structure.files import File

    for name, content in {**curves(), **view_images()}.items():
        files.append(File.generated(config, name, content=content))
    PRESENT.update(file.src_uri for file in files)
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Replace the `{{ ... }}` lines of a page."""
    up = "../" * page.file.src_uri.count("/")

    def fill(mark: re.Match[str]) -> str:
        arguments = [part.strip() for part in mark[2].split("|")] if mark[2] else []
        return MARKS[mark[1]](*arguments).replace("](@/", f"]({up}")

    return MARK.sub(fill, markdown)


def models() -> str:
    """Return one section per camera model."""
    return "\n".join(_model(name) for name in om.model_names())


def _model(name: str) -> str:
    cls = om.model_class(name)
    example = cls.example()
    lines = [f"## {name}", "", *_prose(inspect.getdoc(cls) or "")]
    lines += ["| parameter | description | unit | bounds | estimated |", "|---|---|---|---|---|"]
    # Coefficients of one kind share a row.
    for (_, doc), group in itertools.groupby(example.parameters, key=lambda p: (p.name.rstrip("0123456789"), p.doc)):
        p, *rest = group
        bounds = f"{_bound(p.low)} to {_bound(p.high)}" if p.low > -float("inf") or p.high < float("inf") else ""
        named = f"`{p.name}`" + (f" ... `{rest[-1].name}`" if rest else "")
        lines.append(f"| {named} | {_plain(doc)} | {p.unit} | {bounds} | {'yes' if p.free else 'on request'} |")
    supported = [f"`{key}`" for key in _formats() if name in _formats()[key].MODELS]
    lines += ["", f"Supported by the formats {', '.join(supported)}."]
    if _is_central(cls):
        lines += ["", f"![r(theta) of the example of {name}](@/assets/models/{name}.svg){{ width=420 }}"]
    return "\n".join([*lines, ""])


def ray_models() -> str:
    """Return one section per non-central camera model that can be calibrated."""
    from omnisight.optics.models import ray_model_class, ray_model_names

    sections: list[str] = []
    for name in ray_model_names():
        cls = ray_model_class(name)
        own = [p for p in cls.example().parameters if p.unit != "px" and p.unit]
        rows = [f"| `{p.name}` | {_plain(p.doc)} | {p.unit} |" for p in own]
        prose = _prose((inspect.getdoc(cls) or "").partition("\n\nAttributes\n")[0])
        sections += [f"### {name}", "", *prose, "| parameter | description | unit |", "|---|---|---|", *rows, ""]
    return "\n".join(sections)


def formats() -> str:
    """Return the table of calibration file formats."""
    lines = ["| `--to` | format | file | models, the most common first |", "|---|---|---|---|"]
    for key, value in _formats().items():
        supported = "every model" if set(value.MODELS) == set(om.model_names()) else ", ".join(value.MODELS)
        lines.append(f"| `{key}` | {_plain(value.TITLE)} | `{value.SUFFIX}` | {supported} |")
    return "\n".join(lines)


def rig_formats() -> str:
    """Return the table of the formats that hold rigs."""
    from omnisight.formats import rig_format_names

    lines = ["| `--to` | format | file |", "|---|---|---|"]
    for key in rig_format_names():
        value = _formats()[key]
        lines.append(f"| `{key}` | {_plain(value.TITLE)} | `{value.SUFFIX}` |")
    return "\n".join(lines)


def conventions() -> str:
    """Return the table of the conventions of each format."""
    lines = ["| format | convention |", "|---|---|"]
    lines += [f"| {_plain(value.TITLE)} | {_plain(value.CONVENTION)} |" for value in _formats().values()]
    return "\n".join(lines)


def readers() -> str:
    """Return the table of the programs that read each format, and of their limits."""
    lines = ["| format | models | read by | right up to | beyond |", "|---|---|---|---|---|"]
    for value in _formats().values():
        held = {model: value.READERS[model] for model in value.MODELS if model in value.READERS}
        for reader in dict.fromkeys(held.values() if value.TITLE != "omnisight JSON" else ()):
            models = ", ".join(model for model, other in held.items() if other == reader)
            limit = "every angle" if reader.theta_max_deg == 180 else f"{reader.theta_max_deg:g}°"
            lines.append(f"| {_plain(value.TITLE)} | {models} | {_plain(reader.name)} | {limit} | {reader.beyond} |")
    return "\n".join(lines)


def corner_formats() -> str:
    """Return the table of corner file formats."""
    from omnisight.corners import corner_format_names, get_corner_format

    lines = ["| format | file | convention |", "|---|---|---|"]
    for value in map(get_corner_format, corner_format_names()):
        lines.append(f"| {_plain(value.TITLE)} | `{value.SUFFIX}` | {_plain(value.CONVENTION)} |")
    return "\n".join(lines)


def matrix() -> str:
    """Return the table of formats and the models that each supports exactly."""
    found = _formats()
    lines = ["| | " + " | ".join(found) + " |", "|---" * (len(found) + 1) + "|"]
    for name in om.model_names():
        ticks = " | ".join("●" if name in value.MODELS else "" for value in found.values())
        lines.append(f"| [{name}](@/reference/models.md#{name}) | {ticks} |")
    return "\n".join(lines)


def candidates() -> str:
    """Return the models that `--model auto` fits."""
    from omnisight.models import auto_models

    def linked(names: Sequence[str]) -> str:
        return ", ".join(f"[{name}](@/reference/models.md#{name})" for name in names)

    limits = {name: round(math.degrees(om.model_class(name).auto_max_theta)) for name in auto_models(0.0)}
    limited = [f"up to {limit}° off-axis also {linked([name])}" for name, limit in limits.items() if limit < 180]
    return f"{linked([name for name, limit in limits.items() if limit == 180])}; {', '.join(limited)}."


def commands() -> str:
    """Return the help of every command."""
    from omnisight.cli import application

    app = application()
    text = app.generate_docs(output_format="markdown")
    return text[text.index("## omnisight ") :]


def examples() -> str:
    """Return every example with its number, its code, its printed output and its images."""
    sections: list[str] = []
    for path in sorted((ROOT / "examples").glob("[0-9]*.py")):
        text = path.read_text()
        number, _, name = path.stem.partition("_")
        title = f"{int(number)}. {name.replace('_', ' ').capitalize()}"
        summary = inspect.cleandoc(text.split('"""')[1]).splitlines()[0]
        code = f'```python title="examples/{path.name}"\n{text.strip()}\n```'
        output = (ROOT / "docs" / "assets" / "examples" / f"{path.stem}.txt").read_text()
        parts = [f"## {title}", _plain(summary), code, f'```text title="Output"\n{output.rstrip()}\n```']
        images = f"assets/examples/{path.stem}.jpg"
        if images in PRESENT:
            parts.append(f"![Images of example {int(number)}](@/{images})")
        sections.append("\n\n".join(parts))
    return "\n\n".join(sections)


def api() -> str:
    """Return the documentation of every public name, grouped by module."""
    sections: list[str] = []
    names = sorted(om._MODULES, key=lambda name: (om._MODULES[name], name))
    for module, group in itertools.groupby(names, om._MODULES.get):
        sections += [f"## {module}", *(f"::: {module}.{name}" for name in group)]
    return "\n\n".join(sections)


def members(module: str) -> str:
    """Return the documentation of the public classes and functions of a module."""
    namespace = importlib.import_module(module)
    own = [name for name, value in vars(namespace).items() if getattr(value, "__module__", "") == module]
    names = [name for name in getattr(namespace, "__all__", own) if name[0] != "_"]
    names = [name for name in names if callable(getattr(namespace, name))]
    return "\n\n".join(f"::: {module}.{name}" for name in names)


def image(path: str, caption: str) -> str:
    """Return an image of docs/ with its caption, if the image exists."""
    return f"![{caption}](@/{path})\n*{caption}*" if path in PRESENT else ""


def file(name: str, fallback: str = "") -> str:
    """Return a file of the repository without its title, or `fallback` if it does not exist."""
    path = ROOT / name
    return path.read_text().partition("\n")[2] if path.exists() else fallback


MARKS = {
    function.__name__: function
    for function in (
        *(models, ray_models, formats, corner_formats, conventions, readers, matrix, candidates, commands),
        *(examples, api, members, image, file, rig_formats),
    )
}


def curves() -> dict[str, str]:
    """Draw the radial profile of the example of every model that has one."""
    from omnisight.pipeline.conversion.inspect import radial_profile
    from omnisight.report.drawings.radial_profile import profile_svg

    drawn: dict[str, str] = {}
    for name in om.model_names():
        cls = om.model_class(name)
        if _is_central(cls):
            example = cls.example()
            centre, _ = example.project([0.0, 0.0, 1.0])
            camera = om.Camera(example, (round(2 * centre[0]), round(2 * centre[1])))
            drawn[f"assets/models/{name}.svg"] = profile_svg(radial_profile(camera))
    return drawn


def view_images() -> dict[str, bytes]:
    """Render every type of view of a room."""
    from omnisight.simulation import fisheye_setup, mirror_setup
    from omnisight.views.cube import CUBE_FACES, cube_rotation

    fisheye, mirror = fisheye_setup(), mirror_setup()
    room, mirror_room = fisheye.renderer()().image, mirror.renderer()().image
    level, upright = om.look(pitch=8), om.look(up="back")
    drawn: dict[str, Any] = {"fisheye_image": room, "mirror_image": mirror_room}
    for name, target in {
        "perspective": om.perspective((640, 400), 100),
        "panini": om.panini((640, 360), 165),
        "sphere": om.sphere(720),
        "fisheye": om.fisheye(400, 180, "equisolid"),
    }.items():
        drawn[name] = om.remap(room, fisheye.camera, target, level, interpolation="bicubic")
    for name, target, rotation in (
        ("cylinder", om.cylinder(960, (-50, 18)), upright),
        ("mercator", om.mercator(960, (-50, 18)), upright),
        ("planet", om.planet(400, 215), om.look(pitch=-90, up="back")),
        ("wrong_flip", om.cylinder(960, (-50, 18)), om.look(up="back", flip=True)),
    ):
        drawn[name] = om.remap(mirror_room, mirror.camera, target, rotation, interpolation="bicubic")
    for face in CUBE_FACES:
        drawn[f"cube_{face}"] = om.remap(room, fisheye.camera, om.cube_face(200), cube_rotation(face, level))
    with tempfile.TemporaryDirectory() as folder:
        files: dict[str, bytes] = {}
        for name, pixels in drawn.items():
            path = Path(folder) / f"{name}.jpg"
            om.write_image(path, pixels)
            files[f"assets/views/{name}.jpg"] = path.read_bytes()
    return files


def _formats() -> dict[str, Any]:
    from omnisight.formats import format_names, get_format

    return {name: get_format(name) for name in format_names()}


def _is_central(cls: type) -> bool:
    from omnisight.models._profile_camera import ProfileCamera

    return issubclass(cls, ProfileCamera)


def _prose(text: str) -> list[str]:
    """Convert a docstring to Markdown; paragraphs that are formulas become code blocks."""
    lines: list[str] = []
    for paragraph in text.split("\n\n"):
        formula = "=" in paragraph and not paragraph.rstrip().endswith(".")
        lines += ["```text", paragraph, "```", ""] if formula else [_plain(" ".join(paragraph.split())), ""]
    return lines


def _plain(text: str) -> str:
    """Escape characters of formulas that Markdown would interpret."""
    return re.sub(r"([*_|\[\]`])", r"\\\1", text).replace("<", "&lt;")


def _bound(value: float) -> str:
    return "-∞" if value == -float("inf") else "∞" if value == float("inf") else f"{value:g}"
