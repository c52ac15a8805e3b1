"""Report of `omnisight odometry`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.cli._output import warn, write_json
from omnisight.display import rounded
from omnisight.pipeline.odometry.odometry_result import OdometryResult
from omnisight.visual_odometry.frame_result import LostSegment
from omnisight.visual_odometry.loop_result import Loop

# Frames between loops that are printed as one series.
SERIES_FRAMES = 50


def print_json(result: OdometryResult) -> None:
    """Print the result as one JSON object."""
    data = {
        "frames": result.frames,
        "tracked": len(result.trajectory),
        "keyframes": result.keyframes,
        "loops": len(result.loops),
        "loop_list": [_loop(loop) for loop in result.loops],
        "rejected_loops": [_loop(loop) for loop in result.rejected_loops],
        "loop_correction": result.correction,
        "path_length": result.path_length,
        "unit": result.unit,
        "has_scale": result.has_scale,
        "scale_source": result.scale.source if result.scale else None,
        "scale_sigma": round(result.scale.relative_sigma, 5) if result.scale else None,
        "fps": None if math.isnan(result.fps) else round(result.fps, 2),
        "dropped": result.dropped,
        "start_seconds": round(result.start_seconds, 3),
        "lost": [
            {"first": lost.first, "last": lost.last, "reason": lost.reason, "recovery": lost.recovery}
            for lost in result.lost
        ],
        "segments": [{"first": part.first, "last": part.last, "world": part.world} for part in result.segments],
        "residual": None if math.isnan(result.residual) else round(result.residual, 3),
        "warnings": list(result.warnings),
        "reason": result.reason,
    }
    write_json(data)


def print_report(result: OdometryResult, output: Path) -> None:
    """Print the trajectory in numbers, and the frames that have no pose."""
    tracked, turned = len(result.trajectory), sum(p.motion == "rotation only" for p in result.trajectory)
    still = f", {turned} of them of a camera that only turned" if turned else ""
    print(f"frames      {tracked} of {result.frames} have a pose{still}; {result.keyframes} keyframes")
    unknown = "; the scale is unknown, and 1 is the distance of the first two keyframes"
    print(f"path        {result.path_length:.2f} {result.unit}{unknown if result.unit == 'baselines' else ''}")
    print_loops(result)
    if result.scale:
        print(f"scale       from {result.scale.source}, {rounded(100 * result.scale.relative_sigma)}% (1σ)")
    for lost in result.lost:
        print(f"lost        {_describe(lost)}")
    if len(result.segments) > 1:
        worlds = len({part.world for part in result.segments})
        joined = "joined by loops" if worlds == 1 else f"in {worlds} worlds, whose relative scale is not known"
        print(f"segments    {', '.join(f'{part.first} to {part.last}' for part in result.segments)}: {joined}")
    if result.dropped is not None:
        arrived = result.frames + result.dropped
        print(f"dropped     {result.dropped} of {arrived} frames, which arrived while an earlier one was processed")
    rate = "" if math.isnan(result.fps) else f"{result.fps:.1f} frames per second after "
    print(f"time        {rate}{result.start_seconds:.1f} s for the start")
    print(f"written     {output}")


def print_loops(result: OdometryResult) -> None:
    """Print the places that were seen again: one line for a series of consecutive ones."""
    if not result.loops:
        return
    rejected = f"; {len(result.rejected_loops)} similar places rejected" if result.rejected_loops else ""
    moved = f"{rounded(result.correction, 3)} {result.unit}"
    print(f"loops       {len(result.loops)} closed, which moved poses by up to {moved}{rejected}")
    for series in _series(result.loops):
        first, last = [loop.first for loop in series], [loop.last for loop in series]
        points = [loop.inliers for loop in series]
        print(
            f"            frames {min(last)} to {max(last)} return to {min(first)} to {max(first)}: {len(series)} loops"
            f" of {min(points)} to {max(points)} points"
        )


def print_warnings(result: OdometryResult) -> None:
    """Print warnings on stderr."""
    for warning in result.warnings:
        warn(warning)


def _loop(loop: Loop) -> dict[str, Any]:
    """Return a loop for JSON."""
    return {
        "first": loop.first,
        "last": loop.last,
        "matches": loop.matches,
        "inliers": loop.inliers,
        "directions": round(loop.directions, 3),
        "distance": float(np.linalg.norm(loop.first_from_last.translation)),
        "scale": loop.scale,
    }


def _series(loops: Sequence[Loop]) -> list[list[Loop]]:
    """Return the loops in series of about the same places."""
    series: list[list[Loop]] = []
    for loop in sorted(loops, key=lambda each: (each.last, each.first)):
        for group in series:
            before = group[-1]
            if max(abs(loop.last - before.last), abs(loop.first - before.first)) <= SERIES_FRAMES:
                group.append(loop)
                break
        else:
            series.append([loop])
    return series


def _describe(lost: LostSegment) -> str:
    """Return which frames were lost, why, and how the trajectory goes on."""
    frames = f"frame {lost.first}" if lost.first == lost.last else f"frames {lost.first} to {lost.last}"
    goes_on = {
        "": "to the end",
        "tracking": "tracked afterwards",
        "relocalization": "relocalized afterwards",
        "rotation only": "then the camera turned without moving",
        "new segment": "then a new segment, whose place and scale are extrapolated",
    }
    return f"{frames}: {lost.reason}; {goes_on[lost.recovery]}"
