"""Discovery and writing of exports of simulated data sets."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import cast

from omnisight.extensions import module_in, names_in
from omnisight.images import write_bytes
from omnisight.simulation.exports._protocol import SequenceExport, SimulatedSequence

PACKAGE = "omnisight.simulation.exports"
# Lists the files, to remove them with the data set.
MANIFEST = "exports.txt"


def export_names() -> tuple[str, ...]:
    """Return the names of all exports, sorted: the names of the files in this folder."""
    return names_in(PACKAGE)


def get_export(name: str) -> SequenceExport:
    """Return the export of this name; raise ValueError with the known names if there is none."""
    return cast(SequenceExport, module_in(PACKAGE, name, "export of data sets"))


def write_exports(names: Sequence[str], sequence: SimulatedSequence) -> list[str]:
    """Write exports into the folder of a data set; return their sections of its README."""
    if not names:
        return []
    with (sequence.folder / MANIFEST).open("w", encoding="utf-8") as manifest:
        for name in names:
            for path, content in get_export(name).files(sequence):
                manifest.write(f"{path}\n")
                target = sequence.folder / path
                target.parent.mkdir(parents=True, exist_ok=True)
                if isinstance(content, bytes):
                    write_bytes(target, content)
                else:
                    _link(content, target)
    return [get_export(name).DESCRIPTION for name in names]


def remove_exports(folder: Path) -> None:
    """Remove the files that `write_exports` listed in a folder, and folders that are then empty."""
    manifest = folder / MANIFEST
    if not manifest.is_file():
        return
    parents: set[Path] = set()
    for line in manifest.read_text(encoding="utf-8", errors="replace").splitlines():
        path = PurePosixPath(line)
        if line and not path.is_absolute() and ".." not in path.parts:
            (folder / path).unlink(missing_ok=True)
            parents |= {folder / parent for parent in path.parents if parent.parts}
    manifest.unlink()
    for parent in sorted(parents, key=lambda place: -len(place.parts)):
        if parent.is_dir() and not any(parent.iterdir()):
            parent.rmdir()


def _link(source: Path, target: Path) -> None:
    """Make a hard link, or a copy where the file system has no links."""
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
