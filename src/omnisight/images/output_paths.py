"""Labels and output files for images that may come from several folders."""

import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from omnisight.images.collect import IMAGE_SUFFIXES


def image_labels(paths: Sequence[Path]) -> list[str]:
    """Return a label for each image: its file name, preceded by the folder if needed to make labels unique."""
    labels = _first_unique(paths, lambda p: p.name, lambda p: f"{p.parent.name or '.'}/{p.name}")
    return labels or [str(p) for p in paths]


def output_paths(paths: Sequence[Path], folder: Path) -> list[Path]:
    """Return a unique PNG file in the folder for each image.

    Raises
    ------
    ValueError
        If an output file is one of the images.
    """
    files = [folder / f"{stem}.png" for stem in unique_stems(paths)]
    refuse_overwrite(files, paths)
    return files


def unique_stems(paths: Sequence[Path]) -> list[str]:
    """Return a different file name without extension for each image."""
    return _first_unique(
        paths,
        lambda p: p.stem,
        lambda p: p.name.replace(".", "_"),
        lambda p: f"{p.parent.name}_{p.name.replace('.', '_')}",
    ) or [f"{i + 1}_{p.stem}" for i, p in enumerate(paths)]


def drawing_paths(paths: Sequence[Path], folder: Path) -> list[Path]:
    """Return a unique PNG file in the folder for a drawing on each image.

    Raises
    ------
    ValueError
        If an output file is one of the images, the folder contains the images, or it is not a folder, or cannot be
        written.
    """
    files = output_paths(paths, folder)
    if folder.suffix.lower() in IMAGE_SUFFIXES and not folder.exists():
        raise ValueError(f"{folder}: has the name of an image; choose a folder for the drawings")
    check_output_folder(folder, [path.parent for path in paths])
    return files


def nearest_existing(folder: Path) -> Path:
    """Return a path, or the nearest of those above it that exists."""
    return next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())


def check_folder_of(output: Path) -> None:
    """Raise `ValueError` if the folder of an output file does not exist, or cannot be written."""
    folder = output.parent
    existing = nearest_existing(folder)
    if not existing.is_dir():
        raise ValueError(f"{output}: {existing} is a file, not a folder")
    if existing != folder:
        raise ValueError(f"{output}: there is no folder {folder}; make it first")
    if reason := write_error(folder):
        raise ValueError(f"{output}: {reason} ({folder})")


def check_output_folder(folder: Path, inputs: Iterable[Path] = ()) -> None:
    """Raise `ValueError` if a folder, which need not exist, is an input, a file, or cannot be written."""
    if folder.resolve() in {path.resolve() for path in inputs}:
        raise ValueError(
            f"{folder}: contains the images, and the output would be read with them next time; choose another folder"
        )
    existing = nearest_existing(folder)
    if not existing.is_dir():
        raise ValueError(f"{existing}: is a file; choose a folder")
    if reason := write_error(existing):
        raise ValueError(f"{folder}: {reason} ({existing}); choose another folder")


def write_error(folder: Path) -> str:
    """Return why no file can be written into a folder; empty if one can."""
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        return f"cannot be written: {error.strerror or error}"
    return ""


def refuse_overwrite(files: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise if an output file is one of the input files."""
    read = {path.resolve() for path in inputs}
    for file in files:
        if file.resolve() in read:
            raise ValueError(f"{file}: is one of the inputs and would be overwritten; choose another output")


def _first_unique(paths: Sequence[Path], *naming: Callable[[Path], str]) -> list[str] | None:
    """Return the names of the first scheme that gives every path a different name, ignoring case."""
    for scheme in naming:
        names = [scheme(path) for path in paths]
        if len({name.casefold() for name in names}) == len(names):
            return names
    return None
