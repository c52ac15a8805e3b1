"""The list of a batch's work, with which a later run is compared."""

import json
import posixpath
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from omnisight.pipeline.batch.storage import FOLDER, absolute_url, file_system, read_below, write_file
from omnisight.pipeline.batch.task import Item, Task

MANIFEST = f"{FOLDER}/manifest.json"


@dataclass(frozen=True)
class Manifest:
    """All items of a run.

    Attributes
    ----------
    task
        Description of the task.
    source
        URL of the files.
    items
        The items.
    """

    task: dict[str, Any]
    source: str
    items: tuple[Item, ...]

    def to_json(self) -> str:
        """Return the content of the file of a manifest."""
        items = [[item.inputs, item.outputs, item.group] for item in self.items]
        return json.dumps({**vars(self), "items": items})

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Return the manifest of a file.

        Raises
        ------
        ValueError
            If the file is none.
        """
        try:
            values = json.loads(text)
        except RecursionError:
            raise ValueError("it is nested too deeply") from None
        match values:
            case {"task": {**task}, "source": str(source), "items": [*items]} if len(values) == 3:
                if not isinstance(task.get("options", {}), dict):
                    raise ValueError("the options are not an object")
                return cls(task, source, tuple(_item(item, k) for k, item in enumerate(items)))
            case _:
                raise ValueError("it has no task, source and items")


def _item(values: Any, index: int) -> Item:
    """Return an item of a manifest."""
    match values:
        case [[*inputs], [*outputs], int(group)] if inputs and all(isinstance(path, str) for path in inputs + outputs):
            return Item(tuple(inputs), tuple(outputs), group)
        case _:
            raise ValueError(f"item {index} has no inputs, outputs and group")


def check_manifest(task: Task, items: Sequence[Item], source: str, output: str) -> None:
    """Write the manifest of a run to its output folder, or check that the one in it is equal.

    Raises
    ------
    ValueError
        If the folder has the manifest of another task, of another archive, or of other files.
    """
    manifest = Manifest(task.description, absolute_url(source), tuple(items))
    stored = read_below(output, MANIFEST)
    if stored is None:
        write_file(output, MANIFEST, manifest.to_json().encode())
        return
    try:
        before = Manifest.from_json(stored)
    except ValueError as error:
        raise ValueError(
            f"{output}/{MANIFEST}: is not a manifest ({error}); delete the folder {FOLDER} to start again"
        ) from None
    advice = f"choose another output, or delete {output}/{FOLDER} to start again"
    was, now = _flat(before.task), _flat(manifest.task)
    if changed := [name for name in now | was if was.get(name) != now.get(name)]:
        name = changed[0]
        raise ValueError(
            f"{output}: holds a run with another {name.replace('_', ' ')} ({was.get(name)}, now {now.get(name)}):"
            f" {advice}"
        )
    if file_system(before.source) != file_system(source):
        raise ValueError(f"{output}: holds a run over images of {before.source}, not of {manifest.source}: {advice}")
    if before.items != manifest.items:
        old, new = ({path for item in each.items for path in item.inputs} for each in (before, manifest))
        raise ValueError(
            f"{output}: holds a run over other images of {before.source} ({len(new - old)} new, {len(old - new)}"
            f" missing): {advice}"
        )


def _flat(task: dict[str, Any]) -> dict[str, Any]:
    """Return a description with the options of a command and the other parts."""
    return {name: value for name, value in task.items() if name != "options"} | task.get("options", {})


def items_of_images(versions: Mapping[str, str], suffix: str) -> list[Item]:
    """Return an item for each image, whose output has its path below their common folder, with another suffix."""
    names = output_names(list(versions), suffix)
    return [
        Item((path,), (name,), version=version) for (path, version), name in zip(versions.items(), names, strict=True)
    ]


def output_names(paths: Sequence[str], suffix: str) -> list[str]:
    """Return a unique output for each file: its path below the common folder, with another suffix."""
    root = posixpath.commonpath([posixpath.dirname(path) for path in paths])
    below = [posixpath.relpath(path, root or ".") for path in paths]
    stems = [posixpath.splitext(name)[0] for name in below]
    counts = Counter(stem.casefold() for stem in stems)
    return [
        (stem if counts[stem.casefold()] == 1 else name.replace(".", "_")) + suffix
        for stem, name in zip(stems, below, strict=True)
    ]
