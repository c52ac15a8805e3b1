"""Report of `omnisight odometry`."""

import json
import math
import sys
from pathlib import Path

from omnisight.pipeline.odometry import OdometryResult
from omnisight.visual_odometry.frame_result import LostSegment


def print_json(result: OdometryResult) -> None:
    """Print the result as one JSON object."""
    data = {
        "frames": result.frames,
        "tracked": len(result.trajectory),
        "keyframes": result.keyframes,
        "loops": result.loops,
        "path_length": result.path_length,
        "unit": result.unit,
        "has_scale": result.has_scale,
        "scale_source": result.scale.source if result.scale else None,
        "scale_sigma": round(result.scale.relative_sigma, 5) if result.scale else None,
        "fps": None if math.isnan(result.fps) else round(result.fps, 2),
        "start_seconds": round(result.start_seconds, 3),
        "lost": [
            {"first": lost.first, "last": lost.last, "reason": lost.reason, "recovery": lost.recovery}
            for lost in result.lost
        ],
        "residual": None if math.isnan(result.residual) else round(result.residual, 3),
        "warnings": list(result.warnings),
        "reason": result.reason,
    }
    print(json.dumps(data, indent=2, allow_nan=False))


def print_report(result: OdometryResult, output: Path) -> None:
    """Print the trajectory in numbers, and the frames that have no pose."""
    tracked, turned = len(result.trajectory), sum(p.motion == "rotation only" for p in result.trajectory)
    still = f", {turned} of them of a camera that only turned" if turned else ""
    print(f"frames      {tracked} of {result.frames} have a pose{still}; {result.keyframes} keyframes")
    unknown = "; the scale is unknown, and 1 is the distance of the first two keyframes"
    print(f"path        {result.path_length:.2f} {result.unit}{unknown if result.unit == 'baselines' else ''}")
    if result.scale:
        print(f"scale       from {result.scale.source}, {result.scale.relative_sigma:.1%} (1σ)")
    for lost in result.lost:
        print(f"lost        {_describe(lost)}")
    rate = "" if math.isnan(result.fps) else f"{result.fps:.1f} frames per second after "
    print(f"time        {rate}{result.start_seconds:.1f} s for the start")
    print(f"written     {output}")


def print_warnings(result: OdometryResult) -> None:
    """Print warnings on stderr."""
    for warning in result.warnings:
        print(f"omnisight: warning: {warning}", file=sys.stderr)


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
