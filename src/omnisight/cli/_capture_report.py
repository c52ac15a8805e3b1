"""Progress and report of `omnisight capture`."""

import shlex
import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from omnisight.cli._output import is_quiet, write_json
from omnisight.pipeline.calibration.capture import CaptureResult, Show
from omnisight.pipeline.calibration.capture_options import CaptureOptions
from omnisight.pipeline.calibration.capture_session import CaptureSession, JudgedCandidate
from omnisight.report.drawings.capture import draw_capture
from omnisight.report.live.server import LivePage
from omnisight.view_planning.description import describe_placement, direction_text, error_text


@contextmanager
def live_view(source: str, options: CaptureOptions, *, has_page: bool) -> Generator[Show]:
    """Show the capture as a line on stderr, if it is a terminal, and as a page."""
    has_line = not is_quiet() and sys.stderr.isatty()
    with ExitStack() as stack:
        page = stack.enter_context(LivePage(f"Capture of {source}")) if has_page else None
        if page is not None:
            print(f"page      {page.url}", file=sys.stderr, flush=True)

        def show(session: CaptureSession, judged: JudgedCandidate) -> None:
            if has_line:
                print(f"\r{_line(session, judged, options)}\x1b[K", end="", file=sys.stderr, flush=True)
            if page is not None:
                page.show(draw_capture(session, judged), judged.advice or "stored", page_rows(session, options))

        yield show
        if has_line:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def print_report(result: CaptureResult, output: Path, options: CaptureOptions) -> None:
    """Print the images, what they cover, and the next command."""
    session = result.session
    ends = {"coverage": "enough", "end": "end of the images", "interrupted": "interrupted"}
    print(f"frames    {result.found} of {result.searched} show the board; {ends[result.reason]}")
    print(f"images    {len(result.images)} in {output}")
    print(f"coverage  {_coverage(session)}")
    if session.proposal is not None:
        worst = session.proposal.worst
        prior = session.proposal.prior
        print(f"worst     {error_text(prior, worst)} (1σ), {direction_text(prior, worst)}")
    if result.reason != "coverage" and (pose := _next_pose(session)):
        print(f"next      {pose}")
    board = ["--target", str(options.target)] if options.target else ["--pattern", str(session.board)]
    board += ["--square", options.square] if options.square else []
    print(f"calibrate {shlex.join(['omnisight', 'calibrate', str(output), *board, '-o', 'camera.json'])}")


def nothing_stored(result: CaptureResult) -> str:
    """Return why no image was stored: the number of frames for each advice."""
    advice = "; ".join(f"{text} ({count} frame{'s' * (count > 1)})" for text, count in result.rejected.items())
    board = ""
    if result.searched and not result.found:
        board = f". Is {result.session.board} the board? --pattern counts inner corners"
    shown = f"{result.found} of {result.searched} frames show the board"
    return f"no image was stored: {shown}{f'; advice: {advice}' if advice else ''}{board}"


def as_json(result: CaptureResult) -> None:
    """Print the result as one JSON object."""
    session = result.session
    coverage, proposal = session.coverage, session.proposal
    data = {
        "images": [str(image) for image in result.images],
        "searched": result.searched,
        "found": result.found,
        "reason": result.reason,
        "rejected": dict(result.rejected),
        "coverage": None if coverage is None else coverage.share,
        "missing": "" if coverage is None else coverage.missing(),
        "worst_px": None if proposal is None else proposal.worst.error_px,
        "calibrated_deg": None if proposal is None else float(np.degrees(proposal.prior.theta_max)),
        "next": _next_pose(session) or None,
    }
    write_json(data)


def _line(session: CaptureSession, judged: JudgedCandidate, options: CaptureOptions) -> str:
    """Return the status in one line."""
    count = len(session.detections.images)
    advice = judged.advice or "stored"
    pose = _next_pose(session) if judged.advice and count >= 3 else ""
    line = f"{count}/{options.images} images  coverage {_share(session)}  {advice}" + (f"; {pose}" if pose else "")
    return line[: _terminal_width() - 1]


def page_rows(session: CaptureSession, options: CaptureOptions) -> dict[str, str]:
    """Return the figures below the image of the page."""
    rows = {"Images": f"{len(session.detections.images)} of at least {options.images}", "Coverage": _coverage(session)}
    if session.proposal is not None:
        prior, worst = session.proposal.prior, session.proposal.worst
        rows["Largest uncertainty"] = f"{error_text(prior, worst)} (1σ), {direction_text(prior, worst)}"
    if pose := _next_pose(session):
        rows["Next"] = f"{pose} (green outline; the thick edge is nearer to the camera)"
    return rows


def _coverage(session: CaptureSession) -> str:
    """Return how much of the field of view has corners, and what is missing."""
    if session.coverage is None:
        return "unknown before three images of different poses"
    missing = session.coverage.missing()
    return f"{_share(session)} of the visible directions" + (f"; missing: {missing}" if missing else "")


def _share(session: CaptureSession) -> str:
    return "-" if session.coverage is None else f"{100 * session.coverage.share:.0f} %"


def _next_pose(session: CaptureSession) -> str:
    """Return where to hold the board next; empty if unknown."""
    proposal = session.proposal
    return describe_placement(proposal, proposal.views[0]) if proposal is not None and proposal.views else ""


def _terminal_width() -> int:
    from shutil import get_terminal_size

    return get_terminal_size().columns
