"""Every command has a public function with the same options."""

import dataclasses
import inspect
import re
import typing

import pytest

import omnisight as om

FUNCTIONS = {
    "calibrate": om.calibrate,
    "calibrate-lines": om.calibrate_lines,
    "capture": om.capture,
    "convert": om.convert,
    "design": om.design,
    "detect": om.detect,
    "epipolar": om.epipolar,
    "evaluate": om.evaluate,
    "export": om.export,
    "next": om.next_view,
    "odometry": om.odometry,
    "reconstruct": om.reconstruct,
    "simulate": om.simulate,
    "stereo": om.stereo,
    "stitch": om.stitch,
    "view": om.view,
}
# Fields that are positional arguments of their command.
POSITIONAL = {"scene"}
# Fields whose option has another name: `format` is a builtin of Python, and each --fix adds one value to `fixed`.
RENAMED = {"format": "to", "fixed": "fix", "max_theta_deg": "max-theta", "max_error_px": "max-error"}
# Fields that are groups of options.
GROUPS = {
    "motion_sensors": ("imu", "odometry", "gnss", "sensor-noise", "origin"),
    "conditions": ("time", "weather", "exposure-drift", "visit", "traffic"),
}
# Settings of the estimation from lines that the command does not offer.
PYTHON_ONLY = {"calibrate-lines": {"square", "loss", "seed"}}


def options_type(function):
    """Return the type of the parameter `options`."""
    annotation = typing.get_type_hints(function)["options"]
    (options,) = [item for item in typing.get_args(annotation) or (annotation,) if item is not type(None)]
    return options


@pytest.mark.parametrize("command", FUNCTIONS)
def test_the_function_of_a_command_is_public_typed_and_documented(command):
    function = FUNCTIONS[command]
    assert function.__name__ in dir(om)
    assert function.__name__ in om.__all__
    hints = typing.get_type_hints(function)
    assert set(hints) == {*inspect.signature(function).parameters, "return"}
    sections = inspect.getdoc(function)
    assert len(sections.splitlines()[0]) > 20
    assert "Parameters\n----------" in sections
    for name in inspect.signature(function).parameters:
        assert re.search(rf"^(\w+, )*{name}(, \w+)*$", sections, re.MULTILINE), name


@pytest.mark.parametrize("command", FUNCTIONS)
def test_every_field_of_the_options_is_documented_and_an_option_of_the_command(run, command):
    options = options_type(FUNCTIONS[command])
    assert options.__name__ in dir(om)
    status, out, _ = run(command, "--help")
    assert status == 0
    fields = dataclasses.fields(options)
    assert fields
    documentation = "\n".join(base.__doc__ for base in options.__mro__ if base.__doc__)
    for field in fields:
        assert re.search(rf"^ *(\w+, )*{field.name}(, \w+)*$", documentation, re.MULTILINE), field.name
        if field.name in PYTHON_ONLY.get(command, ()):
            continue
        if field.name in POSITIONAL:
            assert re.search(rf"^│ \* +{field.name.upper()} ", out, re.MULTILINE), field.name
        else:
            for name in GROUPS.get(field.name, (RENAMED.get(field.name, field.name),)):
                assert re.search(rf"--{name.replace('_', '-')}\b", out), name


@pytest.mark.parametrize("command", FUNCTIONS)
def test_every_option_has_a_description(run, command):
    out = run(command, "--help")[1]
    rows = re.findall(r"^│ (?:[* ]  )?(--.*?|[A-Z]+)(?: {2,}(\S.*?))? *│$", out, re.MULTILINE)
    assert len(rows) > 5
    for option, description in rows:
        assert re.match(r"\w", description), option
    assert "--empty-" not in out
