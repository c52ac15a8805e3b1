"""Write reconstructions in any format, and read omnisight's own."""

from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import cast

from omnisight.extensions import module_in, names_in
from omnisight.formats import save
from omnisight.images import write_bytes
from omnisight.reconstructions import colmap, native, splat
from omnisight.reconstructions._protocol import ExportOptions, OutputFile, ReconstructionError, ReconstructionFormat
from omnisight.sfm.reconstruction import Reconstruction

PACKAGE = "omnisight.reconstructions"
# What `write_reconstruction` writes; the native file last, because a folder without it is incomplete.
MODEL_FORMATS = ("poses_csv", "ply", "native")
COLMAP_FOLDER = "colmap"
RIG_FILE = "rig.json"
# All files of the folder of a reconstruction besides the native one.
FILES = (
    *("poses.csv", "points.ply", "cameras.ply", "viewer.html", RIG_FILE),
    *(f"{COLMAP_FOLDER}/{name}" for name in colmap.FILES),
)
DEFAULT = ExportOptions()


def reconstruction_format_names() -> tuple[str, ...]:
    """Return the names of all formats, sorted: the names of the files in this folder."""
    return names_in(PACKAGE)


def get_reconstruction_format(name: str) -> ReconstructionFormat:
    """Return the format of this name; raise ValueError with the known names if there is none."""
    return cast(ReconstructionFormat, module_in(PACKAGE, name, "format of reconstructions"))


def export_reconstruction(
    reconstruction: Reconstruction, folder: str | Path, options: ExportOptions
) -> tuple[Path, ...]:
    """Write a reconstruction in a format. Each file is replaced atomically; the folder is created.

    Parameters
    ----------
    reconstruction
        The reconstruction.
    folder
        The folder of the files.
    options
        The format, the folder of the images, and the size of views.

    Returns
    -------
    files
        The files that were written.

    Raises
    ------
    ReconstructionError
        If the format cannot hold the reconstruction, a file cannot be written, or views would be among the images.
    """
    chosen = get_reconstruction_format(options.format)
    views = Path(folder) / splat.IMAGE_FOLDER
    if options.images is not None and chosen.TITLE == splat.TITLE and views.resolve() == options.images.resolve():
        raise ReconstructionError(f"{views}: {splat.IN_IMAGE_FOLDER}")
    try:
        return tuple(_write(Path(folder), chosen.files(reconstruction, options)))
    except (ValueError, OSError) as error:
        raise ReconstructionError(f"{folder}: {chosen.TITLE}: {error}") from error


def write_reconstruction(folder: str | Path, reconstruction: Reconstruction) -> tuple[Path, ...]:
    """Write the folder of a reconstruction: poses.csv, points.ply, cameras.ply and reconstruction.npz.

    Each file is replaced atomically, `reconstruction.npz` last, which `read_reconstruction` reads; the folder is
    created. The subfolder `colmap` has the reconstruction as COLMAP text if COLMAP can represent the cameras, and
    `rig.json` several cameras with their poses.

    Returns
    -------
    files
        The files that were written.

    Raises
    ------
    ReconstructionError
        If a file cannot be written.
    """
    folder = Path(folder)
    try:
        files = [
            file for name in MODEL_FORMATS for file in get_reconstruction_format(name).files(reconstruction, DEFAULT)
        ]
        (folder / RIG_FILE).unlink(missing_ok=True)
        rig = [save(reconstruction.rig, folder / RIG_FILE).path] if len(reconstruction.rig) > 1 else []
        return (*rig, *_write(folder, [*_colmap_files(folder, reconstruction), *files]))
    except (ValueError, OSError) as error:
        raise ReconstructionError(f"{folder}: {error}") from error


def refuse_other_files(folder: str | Path) -> None:
    """Raise if `write_reconstruction` would replace files of a folder without a reconstruction.

    Raises
    ------
    ReconstructionError
        With the first of these files.
    """
    folder = Path(folder)
    if (folder / native.FILE).is_file():
        return
    for name in FILES:
        if (folder / name).exists():
            raise ReconstructionError(
                f"{folder / name}: would be replaced, and the folder has no {native.FILE}, so that it is not of a"
                " reconstruction: choose another output folder, or delete the file"
            )


def remove_reconstruction(folder: str | Path) -> None:
    """Delete the files of a reconstruction in a folder, and the folder if it is then empty; others are kept."""
    folder = Path(folder)
    if not (folder / native.FILE).is_file():
        return
    for name in (native.FILE, *FILES):
        (folder / name).unlink(missing_ok=True)
    for path in (folder / COLMAP_FOLDER, folder):
        if path.is_dir() and not any(path.iterdir()):
            path.rmdir()


def read_reconstruction(folder: str | Path) -> Reconstruction:
    """Read the reconstruction of a folder that `write_reconstruction` wrote.

    Raises
    ------
    ReconstructionError
        If the folder has no reconstruction.npz, or the file is damaged.
    """
    folder = Path(folder)
    path = folder / native.FILE if folder.is_dir() else folder
    if not path.is_file():
        raise ReconstructionError(
            f"{folder}: no reconstruction: {'it has no ' + native.FILE if folder.is_dir() else 'no such folder'};"
            " specify a folder that omnisight reconstruct or omnisight map wrote"
        )
    try:
        return native.read(path)
    except (ValueError, OSError) as error:
        raise ReconstructionError(
            f"{path}: {native.TITLE}: {error}. Make it anew with omnisight reconstruct or omnisight map"
        ) from error


def _colmap_files(folder: Path, reconstruction: Reconstruction) -> list[OutputFile]:
    """Return the files of the subfolder `colmap`; delete those of an earlier reconstruction if there are none."""
    try:
        return [(f"{COLMAP_FOLDER}/{name}", data) for name, data in colmap.files(reconstruction, DEFAULT)]
    except ValueError:
        for name in colmap.FILES:
            (folder / COLMAP_FOLDER / name).unlink(missing_ok=True)
        return []


def _write(folder: Path, files: Iterable[OutputFile]) -> Iterable[Path]:
    """Write files in a folder and return their paths."""
    for name, data in files:
        path = folder / PurePosixPath(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, data)
        yield path
