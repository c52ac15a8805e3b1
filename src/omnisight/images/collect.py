"""Finds the pictures that a user means by folders, files and patterns."""

from __future__ import annotations

import glob
import os
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from .video import CLIPS

EXTENSIONS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".pnm", ".gif")


def collect_images(inputs: Iterable[str | Path], *, clips: bool = False) -> list[Path]:
    """List picture files.

    Parameters
    ----------
    inputs : iterable of str or Path
        Folders (their own files, not those of folders inside), files, and patterns such as `shots/*.png`.
    clips : bool
        List video files too; of a folder only where it holds no pictures.

    Returns
    -------
    list of Path
        Each file once, numbers in names in numeric order (img2 before img10). Files without a picture's
        extension are left out, for a shell expands `shots/*` to everything that lies there.

    Raises
    ------
    FileNotFoundError
        If an input does not exist, or a pattern matches nothing.
    ValueError
        If what exists holds no picture.
    """
    inputs = [inputs] if isinstance(inputs, str | Path) else list(inputs)
    found = [path for item in inputs for path in expand(item)]
    known = (*EXTENSIONS, *CLIPS) if clips else EXTENSIONS
    pictures = [path for path in found if path.suffix.lower() in known]
    if not pictures:
        where = ", ".join(str(item) for item in inputs) or "an empty list of paths"
        kinds = Counter(path.suffix.lower() or "without extension" for path in found)
        others = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common(5)) or "no files"
        supported = " ".join(extension[1:] for extension in known)
        raise ValueError(f"no images in {where} (found {others}). Supported: {supported}, any case")
    return sorted({_identity(path): path for path in reversed(pictures)}.values(), key=natural_key)


def natural_key(path: str | Path) -> list[str | int]:
    """Make a sorting key in which runs of digits count as numbers and case does not matter."""
    pieces = re.split(r"([0-9]+)", str(path).casefold())
    return [int(piece) if i % 2 else piece for i, piece in enumerate(pieces)]


def expand(item: str | Path) -> list[Path]:
    """List the files that a folder, a file or a pattern means; `FileNotFoundError` if there is none."""
    # A file whose name holds brackets exists as it is written, so existence goes before patterns.
    path = Path(item).expanduser()
    if path.is_dir():
        files = [inside for inside in path.iterdir() if inside.is_file() and not inside.name.startswith(".")]
        pictures = any(inside.suffix.lower() in EXTENSIONS for inside in files)
        return [inside for inside in files if not pictures or inside.suffix.lower() not in CLIPS]
    if path.is_file():
        return [path]
    if not glob.has_magic(str(path)):
        raise FileNotFoundError(f"{item}: no such file or folder")
    matches = [Path(match) for match in glob.glob(str(path), recursive=True)]
    if not matches:
        raise FileNotFoundError(f"{item}: the pattern matches nothing")
    return [match for match in matches if match.is_file()]


def _identity(path: Path) -> tuple[int, int] | str:
    """Tell files apart where `IMG.JPG` and `img.jpg`, or two spellings of a path, may be one file."""
    status = path.stat()
    return (status.st_dev, status.st_ino) if status.st_ino else os.path.realpath(path)
