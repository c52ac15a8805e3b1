"""omnisight calibrate-lines."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from omnisight.cli._progress import Report, progress


def calibrate_lines(
    pictures: list[str],
    /,
    *,
    model: str = "unified",
    mask: Path | None = None,
    lines: Path | None = None,
    fix: list[str] | None = None,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    draw: Path | None = None,
    apply_exif: bool = False,
    json: bool = False,
    quiet: bool = False,
) -> None:
    """Calibrate a camera from images of straight lines, without a board.

    One image of a room or of a street may do: edges are traced, and the camera is found to which most of them are
    straight. What is no line to it is left out.

    Parameters
    ----------
    images
        Folders, files or patterns, all of one camera.
    model
        A camera model. Lines determine the unified model but for its handedness; of models that bend freely (ocam,
        kannala_brandt ...) one scale is held where the unified model has it, and that is said.
    mask
        An image that is white where lines may be looked for (in a PBM file: 1). Without it the border of what the lens
        or mirror shows is found.
    lines
        Lines that you have drawn, in place of the edges: JSON, a list of lines, each a list of [u, v], or an object
        with such a list for each image's name; or CSV with the columns line,u,v or image,line,u,v.
    fix
        What is known of the camera: xi=1 for a parabolic mirror.
    output
        Where the camera goes: a JSON file.
    draw
        A folder for the images with their lines: used ones green, what is no line red, great circles blue.
    apply_exif
        Turn images as their EXIF orientation says; a calibration needs them as the sensor read them.
    json
        Print one JSON object and nothing else.
    quiet
        Show no progress.
    """
    from omnisight.calibration import lines as by_lines
    from omnisight.cli._files import must_be_writable
    from omnisight.cli._lines_report import as_json, print_report
    from omnisight.cli._names import drawings, spare
    from omnisight.formats import save
    from omnisight.images import collect_images
    from omnisight.models import model_class

    # What cannot work is said before the work.
    if output is not None:
        must_be_writable(output)
    names = model_class(model).example().param_names
    known = _known(fix or [], names, model)
    paths = collect_images(pictures)
    if output is not None:
        spare([output], [*paths, *([lines] if lines else []), *([mask] if mask else [])])
    if draw is not None:
        drawings(paths, draw)
    with progress(quiet or json) as report:
        chains, size, centre = (
            _traced(paths, mask, apply_exif, report) if lines is None else _drawn(paths, lines, apply_exif)
        )
        found = by_lines.calibrate_lines(
            chains, size, model=model, centre=centre, known=known, trusted=lines is not None, progress=report
        )
    camera = _with_provenance(found.camera, paths, lines)
    # The result first: what is drawn afterwards cannot lose it.
    written = save(camera, output) if output is not None else None
    if json:
        as_json(found, camera)
    else:
        print_report(found, known, written)
    if draw is not None:
        from omnisight.cli._lines_draw import draw_lines

        draw_lines(found, chains, paths, draw, apply_exif=apply_exif)
        if not json:
            print(f"drawn: {draw}")


def _traced(paths: Sequence[Path], mask: Path | None, apply_exif: bool, report: Report) -> tuple[Any, Any, Any]:
    """Give the arcs of the images, their size, and the middle of what the lens or mirror shows (None: unknown)."""
    import numpy as np

    from omnisight.calibration.lines import Chains, find_arcs
    from omnisight.images import estimate_image_field, read_image, to_gray8

    size = _size(paths, apply_exif)
    grays = (to_gray8(read_image(path, apply_exif=apply_exif)) for path in paths)
    field = estimate_image_field(grays)
    allowed = None if mask is None else _mask(mask, size)
    arcs: list[Any] = []
    pictures: list[int] = []
    for i, path in enumerate(paths):
        report("trace edges", i, len(paths))
        found = find_arcs(to_gray8(read_image(path, apply_exif=apply_exif)), field, allowed)
        arcs += found
        pictures += [i] * len(found)
    report("trace edges", len(paths), len(paths))
    return Chains.of(arcs, pictures), size, None if field.outer is None else np.array(field.outer.centre)


def _drawn(paths: Sequence[Path], lines: Path, apply_exif: bool) -> tuple[Any, Any, Any]:
    """Give the lines of a file, the size of the images, and None."""
    from omnisight.calibration.lines import Chains, read_polylines

    size = _size(paths, apply_exif)
    index = {path.name: i for i, path in enumerate(paths)} | {"": 0}
    found = read_polylines(lines)
    if unknown := sorted(set(found) - set(index)):
        raise ValueError(f"{lines}: names {unknown[0]}, which is none of the images ({paths[0].name} ...)")
    drawn = [(line, index[name]) for name, part in found.items() for line in part]
    return Chains.of([line for line, _ in drawn], [i for _, i in drawn]), size, None


def _size(paths: Sequence[Path], apply_exif: bool) -> tuple[int, int]:
    from omnisight.images import read_image

    sizes = [read_image(path, apply_exif=apply_exif).shape[1::-1] for path in paths]
    for path, size in zip(paths, sizes, strict=True):
        if size != sizes[0]:
            raise ValueError(
                f"{path}: is {size[0]} x {size[1]} px and {paths[0].name} {sizes[0][0]} x {sizes[0][1]}: images of"
                " one camera have one size"
            )
    return sizes[0][0], sizes[0][1]


def _mask(path: Path, size: tuple[int, int]) -> Any:
    from omnisight.images import read_bytes, read_image, to_gray8

    gray = to_gray8(read_image(path))
    if gray.shape[::-1] != size:
        raise ValueError(f"{path}: is {gray.shape[1]} x {gray.shape[0]} px, the images {size[0]} x {size[1]}")
    # A bitmap is black on white: what is set in it is read as black.
    allowed = gray < 128 if read_bytes(path)[:2] in (b"P1", b"P4") else gray > 127
    if not allowed.any():
        raise ValueError(f"{path}: allows no pixel; white marks where lines are looked for")
    return allowed


def _known(fix: Sequence[str], names: Sequence[str], model: str) -> dict[str, float]:
    known: dict[str, float] = {}
    for text in fix:
        name, _, value = text.partition("=")
        try:
            known[name.strip()] = float(value)
        except ValueError:
            raise ValueError(f"--fix must be a parameter and its value, such as xi=1, got {text!r}") from None
    if unknown := sorted(set(known) - set(names)):
        raise ValueError(f"--fix: {model} has no {', '.join(unknown)}; it has {', '.join(names)}")
    return known


def _with_provenance(camera: Any, paths: Sequence[Path], lines: Path | None) -> Any:
    import dataclasses

    from omnisight.cli._files import made_now

    provenance = {
        **made_now(),
        "images": [path.name for path in paths],
        **({} if lines is None else {"lines": lines.name}),
    }
    return dataclasses.replace(camera, provenance=provenance)
