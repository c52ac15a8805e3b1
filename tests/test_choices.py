"""Options refuse values that are not among their choices, and name the closest one."""

import dataclasses
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest

import omnisight as om
from omnisight.choices import Options

# Values of the fields that have no default.
REQUIRED: dict[type[Options], dict[str, Any]] = {
    om.SimulateOptions: {"scene": "street", "camera": om.sphere(64), "output": Path("out")}
}


def _option_classes() -> list[type[Options]]:
    public = [getattr(om, name) for name in om.__all__]
    return [value for value in public if isinstance(value, type) and issubclass(value, Options)]


def _fields_with_choices() -> list[tuple[type[Options], str, str]]:
    found = list[tuple[type[Options], str, str]]()
    for cls in _option_classes():
        for field in dataclasses.fields(cls):  # pyright: ignore[reportArgumentType]
            kinds: list[Any] = [field.type, *get_args(field.type)]
            choices = next((get_args(kind) for kind in kinds if get_origin(kind) is Literal), ())
            found += [(cls, field.name, choices[0])] if choices else []
    return found


def test_every_command_with_choices_is_covered() -> None:
    assert {cls.__name__ for cls, _, _ in _fields_with_choices()} >= {
        "CalibrateOptions",
        "OdometryOptions",
        "ReconstructOptions",
        "VideoOptions",
        "ViewOptions",
    }


@pytest.mark.parametrize(("cls", "name", "choice"), _fields_with_choices())
def test_unknown_choices_are_refused_with_the_closest_one(cls: type[Options], name: str, choice: str) -> None:
    option = f"--{name.replace('_', '-')}"
    with pytest.raises(ValueError, match=rf"{option}: unknown choice '{choice}z' \(did you mean {choice}\?\)"):
        cls(**REQUIRED.get(cls, {}), **{name: f"{choice}z"})
    assert getattr(cls(**REQUIRED.get(cls, {}), **{name: choice}), name) == choice


def _fields_of_paths() -> list[tuple[type[Options], str, bool]]:
    return [
        (cls, field.name, get_origin(field.type) is tuple)
        for cls in _option_classes()
        for field in dataclasses.fields(cls)  # pyright: ignore[reportArgumentType]
        if Path in (field.type, *get_args(field.type))
    ]


@pytest.mark.parametrize(("cls", "name", "is_tuple"), _fields_of_paths())
def test_paths_can_be_strings(cls: type[Options], name: str, is_tuple: bool) -> None:
    # The board of a bird's-eye view needs the image that shows it.
    needed = {"ground_board": "board.jpg"} if (cls, name) == (om.BirdseyeOptions, "target") else REQUIRED.get(cls, {})
    files = ["a.json", "b.json"] if is_tuple else "a.json"
    options = cls(**needed | {name: files})
    assert getattr(options, name) == ((Path("a.json"), Path("b.json")) if is_tuple else Path("a.json"))
    if is_tuple:
        assert getattr(cls(**needed | {name: "a.json"}), name) == (Path("a.json"),)
