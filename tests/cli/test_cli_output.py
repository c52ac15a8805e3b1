"""The options --json, --quiet and --verbose of every command, and the closest name for a name that does not exist."""

import inspect
import json
import pkgutil
import re

import pytest
from cli_scene import TRUTH

import omnisight as om
from omnisight import cli
from omnisight.cli import application
from omnisight.cli._output import OutputOptions, is_quiet, with_output_options, write_json
from omnisight.formats import format_names, save
from omnisight.map_formats import map_format_names
from omnisight.models import model_names
from omnisight.optics.design.shapes import KINDS
from omnisight.reconstructions import reconstruction_format_names
from omnisight.simulation import scene_names
from omnisight.targets.boards import board_kinds

COMMANDS = sorted(
    module.name.replace("_", "-") for module in pkgutil.iter_modules(cli.__path__) if not module.name.startswith("_")
)
# Commands on the images of a board, an image, and a camera; the tests of the others read their JSON object.
EXAMPLES = {
    "calibrate": "calibrate shots --pattern 9x6 --model equidistant -o new.json",
    "compare": "compare camera.json other.json",
    "convert": "convert camera.json --to kalibr -o kalibr.yaml",
    "design": "design mirror --up 20 --down 60",
    "detect": "detect shots --pattern 9x6 -o drawn",
    "doctor": "doctor",
    "evaluate": "evaluate camera.json shots --pattern 9x6",
    "export": "export camera.json --to stmap -o map",
    "inspect": "inspect camera.json --svg profile.svg",
    "simulate": "simulate room --camera small.json -o rendered --frames 1 --rays 1",
    "target": "target checkerboard 9x6 --square 24mm",
    "view": "view shots/1.png --camera camera.json -o view.png",
}


@pytest.fixture
def work(folder, tmp_path, monkeypatch):
    """Work in a folder with the files of the examples."""
    monkeypatch.chdir(tmp_path)
    save(TRUTH, "camera.json")
    save(TRUTH, "other.json")
    save(om.fisheye(64, 180), "small.json")
    return tmp_path


def run_example(run, command, work, *options):
    save(TRUTH, work / "camera.json")
    return run(*EXAMPLES[command].split(), *options)


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_every_command_lists_the_options_of_its_output(run, command):
    status, out, _ = run(command, "--help")
    assert status == 0
    for option in ("--json", "--quiet -q", "--verbose -v"):
        assert len(re.findall(rf"^│ {option} +[A-Z]", out, re.MULTILINE)) == 1, option


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_declares_the_options_of_its_output_itself(command):
    module = command.replace("-", "_")
    function = getattr(__import__(f"omnisight.cli.{module}", fromlist=[module]), module)
    assert not {"json", "quiet", "verbose"} & set(inspect.signature(function).parameters)


@pytest.mark.parametrize("command", EXAMPLES)
def test_quiet_prints_nothing_on_success(run, work, command):
    status, out, err = run_example(run, command, work, "--quiet")
    assert (out, err) == ("", "")
    assert status == 0


@pytest.mark.parametrize("command", EXAMPLES)
def test_json_prints_one_object_and_nothing_else(run, work, command):
    status, out, err = run_example(run, command, work, "--json", "--verbose")
    assert status == 0
    assert isinstance(json.loads(out), dict)
    assert err.splitlines()[-1].startswith("total ")


@pytest.mark.parametrize("command", ["calibrate", "simulate"])
def test_verbose_prints_the_time_of_each_step(run, work, command):
    _, out, err = run_example(run, command, work, "-v")
    assert out
    rows = err.splitlines()
    assert len(rows) >= 2
    assert all(re.search(r" \d+\.\d\d s, ", row) for row in rows)


def test_errors_are_printed_with_quiet(run):
    status, out, err = run("inspect", "none.json", "--quiet")
    assert (status, out) == (2, "")
    assert err == "omnisight: none.json: no such file or folder\n"


def test_quiet_and_verbose_exclude_each_other(run):
    assert run("doctor", "-q", "-v")[0] == 2


def test_a_new_command_gets_the_options(capsys):
    def command(text: str) -> None:
        print(text)
        assert is_quiet() == (text == "quiet")
        write_json({"text": text})

    command = with_output_options(command)
    command("text", output_options=OutputOptions(json=True))
    assert json.loads(capsys.readouterr().out) == {"text": "text"}
    assert list(inspect.signature(command).parameters) == ["text", "output_options"]


def test_a_refused_conversion_is_an_object_with_its_reason(run, work):
    wide = om.fisheye(400, 200)
    save(wide, "wide.json")
    status, out, err = run("convert", "wide.json", "--to", "opencv", "--model", "pinhole", "--json")
    data = json.loads(out)
    assert status == 2
    assert data["files"] == []
    assert data["reason"] in err


def test_the_object_of_a_conversion_has_what_scripts_need(run, work):
    data = json.loads(run("convert", "camera.json", "--to", "kalibr", "-o", "new.yaml", "--json")[1])
    assert set(data) >= {"files", "format", "convention", "notes", "read_back_px", "camera", "seconds"}
    assert data["files"] == ["new.yaml"]
    assert data["camera"]["size"] == list(TRUTH.size)
    assert data["camera"]["converted"]
    assert 0 < data["camera"]["max_px"] < 1e-3


NAMES = [
    *(("model", "calibrate shots --pattern 9x6 --model {} -o x.json", name) for name in model_names()),
    *(("model", "convert camera.json --to native --model {} -o x.json", name) for name in model_names()),
    *(("format", "convert camera.json --to {} -o x.json", name) for name in format_names()),
    *(("scene", "simulate {} --camera camera.json -o rendered", name) for name in scene_names()),
    *(("board", "target {} 9x6 --square 24mm", name) for name in board_kinds()),
    *(("mirror", "design mirror --kind {}", name) for name in KINDS),
    *(("format", "export camera.json --to {} -o x", name) for name in map_format_names()),
    *(("format", "export rendered --to {} -o x", name) for name in reconstruction_format_names()),
    *(("paper", "target checkerboard 9x6 --square 24mm --paper {}", name) for name in ("Letter", "Tabloid", "Legal")),
    *(("motion", "simulate room --camera camera.json -o rendered --trajectory {}", name) for name in ("loop", "still")),
    *(("view", "view shots/1.png --camera camera.json -o x.png --to {}", name) for name in ("cylinder", "panini")),
    *(("camera", "inspect camera.json --name {}", name) for name in ("camera",)),
]


@pytest.mark.parametrize(("kind", "command", "name"), NAMES)
def test_a_mistyped_name_gets_the_closest_one(run, work, kind, command, name):
    save(TRUTH, "camera.json")
    mistyped = f"{name[:-1]}q{name[-1]}"
    status, out, err = run(*command.format(mistyped).split())
    assert status == 2
    message = " ".join(re.sub("[│╭╮╰╯─]", " ", out + err).split())
    assert re.search(rf"[Dd]id you mean \"?{name}\b", message), (kind, message)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_mistyped_option_gets_the_closest_one(run, command):
    options = [
        option
        for argument in application()[command].assemble_argument_collection()
        for option in argument.names
        if argument.parse and option.startswith("--") and not option.startswith("--empty-")  # not offered
    ]
    assert {"--json", "--quiet", "--verbose"} <= set(options)
    for option in options:
        status, out, err = run(command, f"{option}q")
        assert status == 2
        assert f"did you mean {option}?" in out + err
