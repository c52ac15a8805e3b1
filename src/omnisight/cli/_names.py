"""Names for images that may come from several folders."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from omnisight.images.collect import IMAGE_EXTENSIONS


def labels(paths: Sequence[Path]) -> list[str]:
    """Name images to a reader: by file name, with the folder where that alone is not enough."""
    return _shortest(paths, lambda p: p.name, lambda p: f"{p.parent.name}/{p.name}") or [str(p) for p in paths]


def outputs(paths: Sequence[Path], folder: Path) -> list[Path]:
    """Give a PNG in the folder for each image, no two the same.

    Raises
    ------
    ValueError
        If one of them is one of the images.
    """
    stems = _shortest(
        paths,
        lambda p: p.stem,
        lambda p: p.name.replace(".", "_"),
        lambda p: f"{p.parent.name}_{p.name.replace('.', '_')}",
    ) or [f"{i + 1}_{p.stem}" for i, p in enumerate(paths)]
    files = [folder / f"{stem}.png" for stem in stems]
    spare(files, paths)
    return files


def drawings(paths: Sequence[Path], folder: Path) -> list[Path]:
    """Give what `outputs` gives, for drawings of the images.

    Raises
    ------
    ValueError
        As `outputs`, or if the folder holds the images, or is none.
    """
    files = outputs(paths, folder)
    if folder.resolve() in {path.parent.resolve() for path in paths}:
        raise ValueError(f"{folder}: holds the images; what is drawn would be taken for images the next time")
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: is a file; name a folder")
    if folder.suffix.lower() in IMAGE_EXTENSIONS and not folder.exists():
        raise ValueError(f"{folder}: is an image's name; name a folder, which may hold the drawings of many")
    return files


def spare(files: Iterable[Path], pictures: Iterable[Path]) -> None:
    """Refuse to write over an image that was given."""
    given = {picture.resolve() for picture in pictures}
    for file in files:
        if file.resolve() in given:
            raise ValueError(f"{file}: is one of the images and would be lost; choose another place to write to")


def _shortest(paths: Sequence[Path], *ways: Callable[[Path], str]) -> list[str] | None:
    for way in ways:
        names = [way(path) for path in paths]
        if len({name.casefold() for name in names}) == len(names):
            return names
    return None
