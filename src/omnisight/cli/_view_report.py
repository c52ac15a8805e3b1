"""Report of `omnisight view`."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from omnisight.cli._output import write_json
from omnisight.pipeline.views.view import ViewResult
from omnisight.pipeline.views.view_options import PANORAMA_TYPES

if TYPE_CHECKING:
    from omnisight.pipeline.views.view_clip import ClipViews

# Warn if more than this share of the view is outside the calibrated field of view.
MAX_EXTRAPOLATED_FRACTION = 0.005


def print_json(results: Sequence[ViewResult], written: "ClipViews | None") -> None:
    """Print the views as one JSON object."""
    data: dict[str, Any] = {"views": [_view_json(result) for result in results]}
    if written is not None:
        for view, time in zip(data["views"], written.times, strict=True):
            view["time_s"] = None if time is None else round(time, 3)
        data["frames"] = written.frames
        data["seconds"] = round(written.seconds, 3)
        data["frames_per_second"] = round(written.frames / max(written.seconds, 1e-9), 2)
    write_json(data)


def print_report(
    results: Sequence[ViewResult], outputs: Sequence[str], written: "ClipViews | None", *, is_up_given: bool
) -> None:
    """Print the coverage, the magnification, warnings, and the file or folder written for each view."""
    times = [None] * len(results) if written is None else written.times
    for result, output, time in zip(results, outputs, times, strict=True):
        _print_view(result, time)
        _print_hints(result, is_up_given=is_up_given, can_mark=time is None)
        if written is None:
            count = len(result.files) + len(result.errors)
            print(f"written   {output if count > 1 else result.files[0]}")
        else:
            print(f"written   {output}")
    if written is not None:
        rate = written.frames / max(written.seconds, 1e-9)
        print(f"frames    {written.frames} in {written.seconds:.1f} s, {rate:.0f} per second")
        clip = written.clip
        if clip.rotation_deg and not clip.upright:
            print(
                f"hint      the clip is marked as rotated by {clip.rotation_deg} degrees, which is ignored, as in a"
                " calibration; --apply-exif rotates it"
            )


def _print_view(result: ViewResult, time: float | None) -> None:
    """Print a view; of a moving view that of a frame, whose time in s is given."""
    target, options = result.target, result.options
    faces = ", six faces" if len(result.rotations) > 1 else ""
    centre, edge = result.magnification
    print(f"view      {options.to}, {target.width}x{target.height}{faces}")
    covered = f"{result.view_fraction:.0%} of the view is covered"
    if note := _size_note(result):
        print(f"note      {note}")
    at = "" if time is None else f", at {time:.2f} s, where it is lowest"
    print(f"coverage  {result.image_fraction:.0%} of the image is visible, {covered}{at}")
    print(f"scale     1 px of the image is {centre:.2f} px wide in the centre of the view, {edge:.2f} px at its edge")


def _size_note(result: ViewResult) -> str | None:
    """Return why the view has another size than requested; None if it has not."""
    size, (width, height) = result.options.size, result.target.size
    if size is None or size == (width, height):
        return None
    if (size[0] // 2 * 2, size[1] // 2 * 2) == (width, height):
        reason = "video codecs need even sides"
    elif result.options.to in PANORAMA_TYPES:
        if size[0] == size[1]:  # only the width was specified
            return None
        reason = "its height follows from the width and the field of view"
    else:
        reason = f"a {result.options.to} is square"
    return f"{width}x{height} instead of {size[0]}x{size[1]} px: {reason}"


def _print_hints(result: ViewResult, *, is_up_given: bool, can_mark: bool) -> None:
    """Print warnings of the calibration and hints of the orientation."""
    source, options = result.source, result.options
    if result.extrapolated_fraction > MAX_EXTRAPOLATED_FRACTION:
        inner = f"within {math.degrees(source.theta_min):.0f} or " if source.theta_min else ""
        limit = f"{inner}beyond {math.degrees(source.theta_max or 0.0):.0f} degrees"
        hint = "; --mark hatches it" if can_mark and not options.mark else ""
        share = f"{result.extrapolated_fraction:.0%} of the view"
        print(f"warning   {share} is {limit}, outside the calibrated field of view{hint}")
    if source.calibration.get("verdict") == "do not use":
        reasons = source.calibration.get("reasons")
        reason = "See omnisight inspect."
        if isinstance(reasons, list) and reasons and isinstance(reasons[0], str):
            reason = reasons[0]
        print(f"warning   the verdict of this calibration is: do not use. {reason}")
    if source.theta_min and not is_up_given:
        blind = f"it is blind within {math.degrees(source.theta_min):.0f} degrees of its axis"
        print(f"hint      a mirror camera ({blind}): --up back is assumed; if text is mirrored: --flip")
    upright = options.up == "top" and options.to in ("cylinder", "mercator", "sphere")
    if upright and result.view_fraction < 0.75:
        print("hint      the camera is assumed upright; if it looks down, up or into a mirror: --up back|front, --flip")


def _view_json(result: ViewResult) -> dict[str, Any]:
    return {
        "to": result.options.to,
        "size": list(result.target.size),
        "image_fraction": round(result.image_fraction, 5),
        "view_fraction": round(result.view_fraction, 5),
        "extrapolated_fraction": round(result.extrapolated_fraction, 5),
        "magnification": [round(m, 4) if math.isfinite(m) else None for m in result.magnification],
        "rotations": [rotation.tolist() for rotation in result.rotations],
        "files": [str(file) for file in result.files],
        "errors": list(result.errors),
    }
