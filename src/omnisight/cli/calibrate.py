"""omnisight calibrate."""

import time
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from omnisight.cli._progress import progress


def calibrate(
    pictures: list[str],
    /,
    *,
    pattern: Annotated[str | None, Parameter(alias="--size")] = None,
    square: str | None = None,
    target: Path | None = None,
    model: str = "auto",
    start: Path | None = None,
    image_size: str | None = None,
    which: str | None = None,
    method: Literal["omnisight", "ocamcalib"] = "omnisight",
    drop: list[str] | None = None,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    draw: Path | None = None,
    report: Path | None = None,
    loss: Literal["huber", "squared"] = "huber",
    square_pixels: bool = False,
    flat: bool = False,
    force: bool = False,
    apply_exif: bool = False,
    cache: bool = True,
    json: bool = False,
    quiet: bool = False,
) -> None:
    """Calibrate a camera from images of a board, or from corners that something else found.

    No guess is needed, of focal length, field of view or centre: lenses and mirrors from 60 to 280 degrees start alone.

    Parameters
    ----------
    images
        Folders, files or patterns such as 'left*.jpg', of images and video clips. Of a clip the frames that say most
        are taken. In place of images, files of corners: .mat of BabelCalib, MATLAB or OCamCalib, .orpc of Deltille,
        mrcal's .vnl, points in OpenCV's YAML or XML or in .npz, what `omnisight detect --json` prints.
    pattern
        Inner corners of the board, columns x rows: a board of 9x7 squares has 8x6. Looked for in the images if
        absent.
    square
        Side of a square with its unit: 32.5mm. Without it lengths are in squares; the camera is the same.
    target
        The board as a file, in place of --pattern and --square: what `omnisight target make` wrote, or a target of
        Kalibr's (YAML).
    model
        A camera model (ocam, mei, kannala_brandt, double_sphere, eucm, unified ...), or auto: several are fitted and
        the one that explains best what it was not calibrated on is taken. Or axial: a camera whose viewpoint moves
        along its axis.
    start
        A file of a lens and its mirror as they were drawn, such as `omnisight design mirror --camera` writes of one
        whose rays do not meet: how they truly stand is found. It needs the board's --square.
    image_size
        Width and height of the images that corners are from, such as 1280x800, where their file does not say.
    which
        Which camera, where a file of corners holds several: its name there.
    method
        omnisight, or ocamcalib: Scaramuzza's original steps, to compare with; both errors are printed.
    drop
        An image to leave out, by its name in the table; may be given several times.
    output
        Where the camera goes: a JSON file.
    draw
        A folder for the images with their corners and residuals drawn in.
    report
        One HTML page with verdict, residuals over every image, uncertainty and the camera in every format.
    loss
        huber, or squared for plain least squares.
    square_pixels
        Hold the pixels square: one focal length for both directions.
    flat
        Take the board as flat. Otherwise its bend is estimated too, and kept if the camera then explains better what
        it was not calibrated on.
    force
        Calibrate from fewer than three images, or although most of them show another board.
    apply_exif
        Turn images as their EXIF orientation says; a calibration needs them as the sensor read them.
    cache
        Remember found boards, by the content of the images.
    json
        Print one JSON object and nothing else.
    quiet
        Show no progress.
    """
    begun = time.perf_counter()
    from omnisight.cli._board import asked_board
    from omnisight.cli._calibrate_report import as_json, print_report
    from omnisight.cli._classic import classic_camera, print_classic, steps
    from omnisight.cli._files import must_be_writable
    from omnisight.cli._given import Given
    from omnisight.cli._start import drawn, must_fit
    from omnisight.cli._viewpoint import print_viewpoint, viewpoint_json
    from omnisight.formats import save
    from omnisight.images.output_paths import drawing_paths, image_labels, refuse_overwrite
    from omnisight.models import model_names
    from omnisight.optics.models import ray_model_names
    from omnisight.pipeline.noncentral import calibrate_rays
    from omnisight.pipeline.pictures import calibrate_pictures
    from omnisight.quality.checks import FEWEST
    from omnisight.quality.noncentral_test import evaluate_noncentrality

    # What cannot work is said before the work.
    for file in (output, report):
        if file is not None:
            must_be_writable(file)
    if output is not None and report is not None and output.resolve() == report.resolve():
        raise ValueError(f"{output}: is named for the camera and for the report; give two files")
    if model not in (known := ("auto", *model_names(), *ray_model_names())):
        raise ValueError(f"unknown camera model {model!r}; there are: {', '.join(known)}")
    drawing = None if start is None else drawn(start, model)
    rays = drawing is not None or model in ray_model_names()
    if rays and method == "ocamcalib":
        said = f"--model {model}" if drawing is None else "--start"
        raise ValueError(f"--method ocamcalib calibrates cameras whose rays meet in a point, and {said} others")
    board = asked_board(pattern, square, target)
    given = Given.of(pictures, board, square=square, image_size=image_size, which=which)
    if draw is not None:
        drawing_paths(given.paths, draw)
    refuse_overwrite([file for file in (output, report) if file is not None], [*given.paths, *([target] if target else [])])
    with progress(quiet or json) as tell:
        search = given.search(tell, apply_exif=apply_exif, cache=cache)
        # Named before any is dropped: a second --drop then still finds what the first table called so.
        names = image_labels([picture.path for picture in search.images])
        search = _without(search, names, drop or [])
        names = [name for name in names if name not in (drop or [])]
        detected = time.perf_counter()
        least = 1 if force else FEWEST
        if sum(len(picture.boards) for picture in search.images) < least:
            raise ValueError(_too_few_found(search, least))
        if search.hint and not force:
            raise ValueError(f"{search.hint} (--force calibrates all the same)")
        if method == "ocamcalib" and search.board is not None and search.board.points[:, 2].any():
            raise ValueError("--method ocamcalib is for flat boards; the points of these corners are of a solid body")
        unit = "squares" if search.board is None else search.board.unit
        if drawing is not None:
            must_fit(drawing, start, search.size, unit)
        result = calibrate_pictures(
            search,
            names=names,
            model="auto" if rays else model,
            loss=loss,
            square=square_pixels,
            flat=flat,
            force=force,
            apply_exif=apply_exif,
            progress=tell,
        )
        classic = None
        if method == "ocamcalib":
            from omnisight.calibration.ocamcalib import calibrate_ocamcalib

            classic = calibrate_ocamcalib(result.calibration.views, result.search.size, progress=tell)
        found = result.calibration
        if rays:
            wanted = model if drawing is None else drawing.model
            found = calibrate_rays(found, wanted, unit=unit, loss=loss, field=result.search.field)
        asked = found.trust.viewpoint if rays else evaluate_noncentrality(result.calibration, unit=unit)
    solved = time.perf_counter()
    own = _with_provenance(found.camera, result.search)
    camera = own if classic is None else _with_provenance(classic_camera(classic, result.calibration), result.search)
    # The result first: what is drawn afterwards cannot lose it. A disk that is full by now loses the file, not the
    # figures: those are printed all the same, with --json the camera among them.
    written, failure = None, None
    try:
        written = save(camera, output) if output is not None else None
    except (OSError, ValueError) as error:
        failure = error
    seconds = {
        "detect": detected - begun + result.looked,
        "solve": solved - detected - result.looked,
        "total": time.perf_counter() - begun,
    }
    if json:
        more: dict[str, Any] = {} if classic is None else {"ocamcalib": steps(classic)}
        as_json(found, result, names, camera, seconds, {**more, **viewpoint_json(asked, found)})
    else:
        print_report(found, result, names, seconds, written, lambda out: print_viewpoint(out, asked, found))
        if classic is not None:
            print_classic(classic, result.calibration)
    if failure is not None:
        raise failure
    if draw is not None:
        from omnisight.report.drawings.residuals import draw_residuals

        residuals = found.state.residuals(found.views)
        num_blank = draw_residuals(result.search, residuals, found.outliers, draw, apply_exif=apply_exif)
        if not json:
            note = f" ({num_blank} without image, since the files are missing)" if num_blank else ""
            print(f"drawn: {draw}{note}")
    if report is not None:
        import sys

        from omnisight.report import ReportOptions, write_report

        write_report(found, report, ReportOptions(["omnisight", *sys.argv[1:]], apply_exif))
        if not json:
            print(f"report: {report}")


def _without(search: Any, known: list[str], dropped: list[str]) -> Any:
    """Leave images out, by their names in the table."""
    import dataclasses

    if unknown := [name for name in dropped if name not in known]:
        near = ", ".join(known[:5]) + (", ..." if len(known) > 5 else "")
        raise ValueError(f"--drop: there is no image {', '.join(unknown)}; there are {near}")
    kept = [picture for picture, name in zip(search.images, known, strict=True) if name not in dropped]
    if not kept:
        raise ValueError("--drop leaves no image; keep three or more")
    return dataclasses.replace(search, images=kept)


def _too_few_found(search: Any, least: int) -> str:
    from omnisight.cli._detect_report import advice
    from omnisight.targets import PointTarget

    pictures = search.images
    # The reason why a file cannot be read names the file.
    reasons = [p.note if p.note.startswith(p.path.name) else f"{p.path.name}: {p.note}" for p in pictures if p.note]
    notes = [f"  {reason}" for reason in reasons[:5]] + ["  ..."] * (len(reasons) > 5)
    if isinstance(search.board, PointTarget):
        said = f"{len(search.found)} of {len(pictures)} images have corners enough; {least} is the least, 10 to 20"
        said += " are good"
        return "\n".join([said, *(f"  {note}" for note in search.notes), *notes])
    if search.board is None:
        said = f"no checkerboard found in {len(pictures)} images, so its size is unknown"
        advice = "give --pattern, inner corners as columns x rows, such as 9x6"
        return "\n".join([f"{said}: {advice}", *notes])
    number = len(search.found)
    said = f"{_kind(search.board)} was found in {number} of {len(pictures)} images"
    if number:
        said += f"; {least} is the least and 10 to 20 are good"
    if number and number == len(pictures):
        return f"{said}: take more, with the board tilted, or calibrate a simple model all the same with --force"
    return "\n".join([f"{said}: {search.hint or advice(search.board)}", *notes])


def _kind(board: Any) -> str:
    return f"the {board} board" if board.kind == "checkerboard" else f"the {board.kind} {board}"


def _with_provenance(camera: Any, search: Any) -> Any:
    import dataclasses

    from omnisight.pipeline.provenance import tool_provenance

    provenance = {
        **tool_provenance(),
        "pattern": str(search.board),
        "target": search.board.to_dict(),
        "images": [p.path.name for p in search.found],
        "images_given": len(search.images),
    }
    return dataclasses.replace(camera, provenance=provenance)
