"""Output files of a command."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omnisight.camera import Camera
    from omnisight.formats import SaveResult
    from omnisight.ray_camera import RayCamera
    from omnisight.rig import Rig


def must_be_writable(output: Path) -> None:
    """Raise before any work if an output file cannot be written."""
    if output.is_dir():
        raise ValueError(f"{output}: is a folder; name a file in it")
    from omnisight.images.output_paths import check_folder_of

    check_folder_of(output)


def must_be_writable_image(output: Path) -> None:
    """Raise before any work if an output image cannot be written, or its extension is not that of an image."""
    from omnisight.images.write import check_image_suffix

    must_be_writable(output)
    check_image_suffix(output)


def refuse_inputs(output: Path, *inputs: str | Path | None) -> None:
    """Raise before any work if an output file is one of the inputs, or an image in one of the folders among them."""
    from omnisight.images import IMAGE_SUFFIXES
    from omnisight.images.output_paths import refuse_overwrite

    paths = [Path(path) for path in inputs if path is not None]
    is_image = output.suffix.lower() in IMAGE_SUFFIXES
    inside = [file for path in paths if is_image and path.is_dir() for file in path.rglob(f"*{output.suffix}")]
    refuse_overwrite([output], [*paths, *inside])


def default_output(name: str) -> Path:
    """Return a file to write in the current folder if none is specified; raise if it exists."""
    output = Path(name)
    if output.exists():
        raise ValueError(f"{output}: exists; specify the file to write: -o {output} replaces it")
    return output


def check_camera_suffix(output: Path) -> None:
    """Raise before any work if the name of a camera file is that of another format: only JSON holds all results."""
    if output.suffix.lower() not in ("", ".json"):
        json = f"{output.stem}.json"
        raise ValueError(
            f"{output}: the camera is written as .json; name it {json}, and convert it afterwards: omnisight convert"
            f" {json} --to NAME -o {output.name}"
        )


def save_calibrated(
    calibrated: "Camera | RayCamera | Rig", output: Path | None
) -> tuple["SaveResult | None", Exception | None]:
    """Write a calibrated camera or rig, and return what was written, and the error if it could not be.

    It is written before any drawing, so that a failed drawing does not lose it; and the result is printed even if the
    disk is full, so the error is to be raised after that.
    """
    from omnisight.formats import save

    if output is None:
        return None, None
    try:
        return save(calibrated, output), None
    except (OSError, ValueError) as error:
        return None, error


def check_calibration_outputs(output: Path | None, report: Path | None, subject: str) -> list[Path]:
    """Return the files of a calibration, of a camera or a rig (`subject`); raise before any work if one is wrong."""
    files = [file for file in (output, report) if file is not None]
    for file in files:
        must_be_writable(file)
    if len({file.resolve() for file in files}) < len(files):
        raise ValueError(f"{output}: specified for both the {subject} and the report; specify two files")
    if report is not None and report.suffix.lower() not in (".html", ".htm"):
        raise ValueError(
            f"{report}: the report is written as HTML; name it {report.stem}.html, which browsers print as PDF"
        )
    return files
