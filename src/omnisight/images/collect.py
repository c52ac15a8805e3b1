"""Collect the image files that folders, file names and glob patterns name."""

import glob
import os
import re
from collections import Counter
from collections.abc import Iterable
from os import PathLike
from pathlib import Path

from omnisight.extensions import no_such_file
from omnisight.images.video_files import VIDEO_SUFFIXES, has_clip_suffix

# Beginnings of the names of folders without recorded images: hidden ones, and drawings, such as omnisight-detect.
IGNORED_FOLDERS = ".", "omnisight-"
# Sub-folders that are searched for images: their search takes about 1 s. A home folder has more.
MAX_FOLDERS = 10_000
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".pnm", ".gif")


def collect_images(inputs: str | PathLike[str] | Iterable[str | PathLike[str]], *, videos: bool = False) -> list[Path]:
    """List image files.

    Parameters
    ----------
    inputs : path or iterable of paths
        Folders, files, and glob patterns such as `images/*.png`. Sub-folders are ignored, except that a folder without
        images is replaced by its only sub-folder with images, such as `cam0` by `cam0/data`.
    videos : bool
        Include video files. Those in a folder are included only if the folder has no images.

    Returns
    -------
    list of Path
        Each file once, in natural order (img2 before img10). Files without the extension of an image are skipped,
        since a shell expands `images/*` to everything in the folder.

    Raises
    ------
    MissingFileError
        If an input does not exist or a pattern matches nothing.
    ValueError
        If none of the files is an image.
    """
    inputs = [inputs] if isinstance(inputs, str | PathLike) else list(inputs)
    files = [path for item in inputs for path in expand_path(item)]
    extensions = (*IMAGE_SUFFIXES, *VIDEO_SUFFIXES) if videos else IMAGE_SUFFIXES
    images = [path for path in files if path.suffix.lower() in extensions]
    if not images:
        where = ", ".join(str(item) for item in inputs) or "an empty list of paths"
        counts = Counter(path.suffix.lower() or "without extension" for path in files)
        others = ", ".join(f"{count} {extension}" for extension, count in counts.most_common(5)) or "no files"
        supported = " ".join(extension[1:] for extension in extensions)
        nested = [str(folder) for item in inputs for folder in folders_with_images(Path(item).expanduser())]
        hint = f". Specify one of the folders in it, such as {nested[0]}" if nested else ""
        raise ValueError(f"no images in {where} (found {others}){hint}. Supported: {supported}, any case")
    return sorted({_file_id(path): path for path in reversed(images)}.values(), key=natural_sort_key)


def natural_sort_key(path: str | Path) -> list[str | int]:
    """Return a sort key that compares digits as numbers and ignores case."""
    parts = re.split(r"([0-9]+)", str(path).casefold())
    return [int(part) if i % 2 else part for i, part in enumerate(parts)]


class MissingFileError(FileNotFoundError, ValueError):
    """An input file or folder does not exist; a `ValueError` too, like every other invalid input."""


def expand_path(item: str | PathLike[str]) -> list[Path]:
    """List the files of a folder, a file name or a glob pattern; raise `MissingFileError` if there is none."""
    # A file name may contain brackets, so test for a file before expanding patterns.
    path = Path(item).expanduser()
    if path.is_dir():
        nested = folders_with_images(path)
        files = _files_in(nested[0] if len(nested) == 1 else path)
        has_images = any(file.suffix.lower() in IMAGE_SUFFIXES for file in files)
        return [file for file in files if not has_images or not has_clip_suffix(file)]
    if path.is_file():
        return [path]
    if not glob.has_magic(str(path)):
        raise MissingFileError(f"{item}: {no_such_file(path)}")
    matches = [Path(match) for match in glob.glob(str(path), recursive=True)]
    if not matches:
        raise MissingFileError(f"{item}: the pattern matches no file")
    return [match for match in matches if match.is_file()]


def folders_with_images(folder: Path) -> list[Path]:
    """Return the folders nearest below a folder that contain images or clips; none if it contains some itself.

    Symbolic links are followed, and each folder is visited once. Folders that cannot be read are left out.

    Raises
    ------
    ValueError
        If the folder has no images and more than `MAX_FOLDERS` sub-folders.
    """
    found, visited, waiting = list[Path](), set[tuple[int, int] | str](), [folder]
    while waiting:
        path = waiting.pop()
        try:
            names, identifier = os.listdir(path), _file_id(path)
        except OSError:
            continue
        if identifier in visited:
            continue
        visited.add(identifier)
        if len(visited) > MAX_FOLDERS + 1:
            raise ValueError(
                f"{folder}: no images, and more than {MAX_FOLDERS} sub-folders: specify the folder of the images"
            )
        if not any(_is_image(path / name) for name in names):
            nested = [path / name for name in names if not name.startswith(IGNORED_FOLDERS)]
            waiting += sorted(filter(os.path.isdir, nested), key=natural_sort_key, reverse=True)
        elif path == folder:
            return []
        else:
            found.append(path)
    return found


def _is_image(path: Path) -> bool:
    """Return whether a path is an image or a clip that is not hidden."""
    is_visible = path.suffix.lower() in (*IMAGE_SUFFIXES, *VIDEO_SUFFIXES) and not path.name.startswith(".")
    return is_visible and os.path.isfile(path)


def _files_in(folder: Path) -> list[Path]:
    """Return the files in a folder that are not hidden."""
    return [file for file in folder.iterdir() if file.is_file() and not file.name.startswith(".")]


def _file_id(path: Path) -> tuple[int, int] | str:
    """Return an identifier that two paths of one file share (symbolic links, case-insensitive file systems)."""
    status = path.stat()
    return (status.st_dev, status.st_ino) if status.st_ino else os.path.realpath(path)
