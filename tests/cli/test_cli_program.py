"""The program itself: help, exit status, faults."""

import os
import pkgutil
import pty
import re
import shutil
import subprocess
import sys

import pytest
from cli_scene import raises_error

import omnisight
from omnisight import cli

COMMANDS = sorted(
    module.name.replace("_", "-") for module in pkgutil.iter_modules(cli.__path__) if not module.name.startswith("_")
)


def test_help_lists_the_commands_and_imports_nothing_slow():
    code = (
        "import sys; from omnisight.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit as exit_: assert not exit_.code\n"
        "print(sorted({'numpy', 'numba', 'scipy', 'cv2'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *shown, imported = done.stdout.strip().splitlines()
    assert imported == "[]"
    assert all(any(command in line.split() for line in shown) for command in COMMANDS)
    assert "Exit status: 0 success, 1 internal error, 2 invalid input or option, 130 interrupted" in " ".join(
        done.stdout.split()
    )


def test_the_package_runs_as_a_module_and_returns_the_exit_status(tmp_path):
    command = [sys.executable, "-m", "omnisight", "inspect", str(tmp_path / "none.json")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == f"omnisight: {tmp_path / 'none.json'}: no such file or folder\n"


def test_version(run):
    assert run("--version")[:2] == (0, f"{omnisight.__version__}\n")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_and_option_has_its_help(run, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    status, out, _ = run(command, "--help")
    assert status == 0
    assert f"omnisight {command}" in out
    options = [line.strip("│* ") for line in out.splitlines() if line.strip("│* ").startswith("--")]
    assert len(options) >= 3
    assert [line for line in options if len(re.split(" {2,}", line)) < 2] == []


@pytest.mark.parametrize("command", [command for command in COMMANDS if command not in ("demo", "doctor")])
def test_missing_arguments_exit_with_status_2(run, command):
    status, out, err = run(command)
    assert status == 2
    assert (out + err).strip()


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("arguments", [("--nonsense",), ("a", "b", "--nonsense", "3")])
def test_invalid_usage_exits_with_status_2(run, command, arguments):
    status, out, err = run(command, *arguments)
    assert status == 2
    assert (out + err).strip()


def test_an_unknown_command_gets_the_closest_one(run):
    status, out, err = run("calibrat")
    assert status == 2
    assert 'Did you mean "calibrate"?' in out + err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("view", "clip.mp4", "-o", "o.mp4", "--fov", "90", "80"),
            "unexpected argument 80: --fov accepts one value; for several, repeat it: --fov 90 --fov 80",
        ),
        (
            ("target", "checkerboard", "--pattern", "9x6"),
            "unknown option --pattern: omnisight target KIND PATTERN takes PATTERN without an option",
        ),
        (
            ("calibrate", "--images=shots"),
            "unknown option --images: omnisight calibrate IMAGES takes IMAGES without an option",
        ),
        (
            ("target", "checkerboard", "9x6", "--square-size", "3cm"),
            "unknown option --square-size (did you mean --square?)",
        ),
        (("target", "aprilgrid", "6x6", "--tag-size", "3cm"), "unknown option --tag-size (did you mean --tag?)"),
        (("calibrate", "rig", "front", "back"), "rig: no such file or folder (did you mean omnisight calibrate-rig?)"),
        (("view", "a.mp4", "--codec", "h265", "-o", "b.mp4"), "--codec h265: this codec is called hevc here"),
        (("target", "checkerboard", "9x6", "--square", "0"), "square: the length '0' must be positive"),
        (("--hlep",), "unknown option --hlep (did you mean --help?)"),
        (
            ("--json", "inspect", "a.json"),
            "unknown option --json: options follow the command: omnisight COMMAND --json",
        ),
        (("view", "--hlep"), "unknown option --hlep (did you mean --help?)"),
        (
            ("target", "circles", "4x11", "--rows", "3"),
            "unknown option --rows; omnisight target --help lists the options",
        ),
        (
            ("target", "checkerboard", "9x6", "--square", "24", "mm"),
            "unexpected argument mm: --square accepts one value",
        ),
        (
            ("target", "make", "checkerboard", "9x6"),
            "unexpected argument 9x6: omnisight target accepts KIND PATTERN; omnisight target --help describes them",
        ),
        (
            ("reconstruct", "images", "-o", "model", "--scale", "first.jpg", "3.2m"),
            "--scale needs 3 values; omnisight reconstruct --help describes them",
        ),
        (
            ("reconstruct", "images", "-o", "model", "--scale", "a.jpg", "b.jpg", "-3m"),
            "--scale: the length '-3m' must be positive",
        ),
        (
            ("reconstruct", "images", "-o", "model", "--scale=a.jpg", "b.jpg"),
            "--scale needs 3 values; omnisight reconstruct --help describes them",
        ),
        (("calibrate", "images", "--square", "-25mm"), "--square: the length '-25mm' must be positive"),
        (
            ("calibrate", "images", "--square", "-o", "camera.json"),
            "--square needs a value; write --square=VALUE if it begins with a dash",
        ),
    ],
)
def test_an_unexpected_argument_is_named_with_what_to_do(run, arguments, message):
    assert run(*arguments) == (2, "", f"omnisight: {message}\n")


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_the_shell_completes_commands_and_options(tmp_path):
    script = tmp_path / "complete.bash"
    install = [sys.executable, "-m", "omnisight", "--install-completion", "--shell", "bash", "-o", str(script)]
    subprocess.run(install, check=True, capture_output=True, env={**os.environ, "HOME": str(tmp_path)})
    words = "COMP_WORDS=({}); COMP_CWORD={}; _omnisight; echo ${{COMPREPLY[@]}}"
    cases = (
        ("omnisight odo", 1, "odometry"),
        ("omnisight calibrate --patt", 2, "--pattern"),
        ("omnisight calibrate images --model kannala", 4, "kannala_brandt"),
        ("omnisight export camera.json --to ffm", 4, "ffmpeg"),
        ("omnisight convert camera.json --to kali", 4, "kalibr"),
        ("omnisight target charuco 9x6 --paper Leg", 5, "Legal"),
        ("omnisight target apr", 2, "aprilgrid"),
    )
    for typed, count, completed in cases:
        command = f"source {script}; {words.format(typed, count)}"
        done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
        assert done.stdout.split() == [completed]


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("omnisight view cli", "view clip.mp4 "),
        ("omnisight calibrate ha", "calibrate hall/"),
        ("omnisight view clip.mp4 -o ou", "-o out.png "),
        ("omnisight inspect cam", "inspect camera.json "),
    ],
)
def test_an_interactive_shell_completes_files(tmp_path, typed, completed):
    install = [sys.executable, "-m", "omnisight", "--install-completion", "--shell", "bash", "-o", "complete.bash"]
    environment = {**os.environ, "HOME": str(tmp_path), "PS1": "ready> ", "TERM": "dumb"}
    subprocess.run(install, check=True, capture_output=True, env=environment, cwd=tmp_path)
    (tmp_path / "hall").mkdir()
    for name in ("clip.mp4", "out.png", "camera.json"):
        (tmp_path / name).touch()
    keyboard, terminal = pty.openpty()
    streams = {"stdin": terminal, "stdout": terminal, "stderr": terminal}
    with subprocess.Popen(["bash", "--norc", "-i"], **streams, env=environment, cwd=tmp_path):
        os.close(terminal)
        for line in ("source complete.bash\n", f"{typed}\t|\x15", "exit\n"):
            shown = _read_until(keyboard, b"|" if line == "exit\n" else b"ready> ")
            os.write(keyboard, line.encode())
    os.close(keyboard)
    assert f"{completed}|" in shown


def _read_until(terminal: int, end: bytes) -> str:
    """Return what a terminal shows up to some text."""
    shown = b""
    while end not in shown:
        shown += os.read(terminal, 4096)
    return shown.decode()


def test_an_internal_error_prints_its_traceback_only_with_debug(run, camera_file, monkeypatch):
    monkeypatch.setattr("omnisight.pipeline.conversion.inspect.load_all", raises_error(RuntimeError("lost the thread")))
    status, out, err = run("inspect", camera_file)
    assert (status, out) == (1, "")
    assert err == "omnisight: internal error: RuntimeError: lost the thread (--debug prints the traceback)\n"
    with pytest.raises(RuntimeError, match="lost the thread"):
        run("inspect", camera_file, "--debug")


def test_debug_prints_the_traceback_of_invalid_input(run, tmp_path):
    with pytest.raises(ValueError, match="no such file"):
        run("--debug", "inspect", tmp_path / "none.json")


def test_an_interruption_exits_with_status_130(run, camera_file, monkeypatch):
    monkeypatch.setattr("omnisight.pipeline.conversion.inspect.load_all", raises_error(KeyboardInterrupt()))
    assert run("inspect", camera_file) == (130, "", "omnisight: interrupted\n")


def test_a_result_folder_of_the_demo_may_be_specified_like_that_of_other_commands(run, tmp_path, monkeypatch):
    folders = []
    monkeypatch.setattr("omnisight.pipeline.demos.demo.demo", lambda output, progress: folders.append(output) or ())
    monkeypatch.setattr("omnisight.cli._demo_report.print_report", lambda results, output: None)
    for arguments in ((tmp_path,), ("-o", tmp_path), ("--output", tmp_path)):
        assert run("demo", *arguments)[0] == 0
    assert folders == [tmp_path] * 3
