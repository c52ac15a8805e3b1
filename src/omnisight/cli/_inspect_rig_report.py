"""Terminal table of the poses of a rig, and of the check of its extrinsics by images."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnisight.display import rounded

if TYPE_CHECKING:
    from omnisight.pipeline.rig_calibration.check_extrinsics import ExtrinsicsCheck
    from omnisight.rig import Rig


def print_rig(rig: "Rig") -> None:
    """Print the position, the viewing direction and the overlap of every camera."""
    import numpy as np

    from omnisight.formats import time_offset_notes

    width = max(6, *map(len, rig.names))
    print(f"== rig of {len(rig)} cameras")
    frame = f"camera {rig.reference}" if rig.reference else rig.provenance.get("rig_frame", "of its own")
    print(f"frame       {frame}; lengths in {'metres' if rig.unit == 'm' else rig.unit}")
    offsets = rig.time_offsets or (None,) * len(rig)
    print(f"  {'camera':<{width}} {'position x, y, z':>26} {'viewing direction':>22}  {'1 sigma':>18}  time offset")
    for name, pose, offset in zip(rig.names, rig.sensor_from_rig, offsets, strict=True):
        rig_from_sensor = pose.inverse()
        place = ", ".join(f"{value:z.4f}" for value in rig_from_sensor.translation)
        view = ", ".join(f"{value:z.3f}" for value in rig_from_sensor.rotation[:, 2])
        sigmas = rig.sigmas(name)
        sigma = "unknown" if sigmas is None else f"{rounded(np.degrees(sigmas[0]))} deg, {rounded(sigmas[1])}"
        time = "unknown" if offset is None else f"{1e3 * offset:.2f} ms"
        print(f"  {name:<{width}} {place:>26} {view:>22}  {sigma:>18}  {time}")
    for note in time_offset_notes(rig):
        print(f"note        {note}")
    if all(all(camera.size) for camera in rig.cameras):
        print("overlap     share of the field of view of a camera (row) that another one sees, at infinity")
        print(f"  {'':<{width}} " + " ".join(f"{name:>{max(5, len(name))}}" for name in rig.names))
        for name, row in zip(rig.names, rig.overlap(), strict=True):
            shares = (f"{100 * v:.0f} %" for v in row)
            cells = " ".join(f"{s:>{max(5, len(n))}}" for s, n in zip(shares, rig.names, strict=True))
            print(f"  {name:<{width}} {cells}")


def print_check(check: "ExtrinsicsCheck", path: Path) -> None:
    """Print the matches of each pair of cameras and the verdict."""
    names = [f"{pair.a}, {pair.b}" for pair in check.pairs]
    width = max(7, *map(len, names))
    print("== extrinsics against the images")
    print(f"  {'cameras':<{width}} matches  agree  agree if inverted")
    for name, pair in zip(names, check.pairs, strict=True):
        print(f"  {name:<{width}} {pair.matches:7}  {pair.consistent:5}  {pair.inverted:17}")
    print(f"verdict     {check.verdict.upper()}: {check.reason.replace('FILE', path.name)}")


def check_data(check: "ExtrinsicsCheck") -> dict[str, Any]:
    """Return the check as JSON."""
    import dataclasses

    return {
        "verdict": check.verdict,
        "reason": check.reason,
        "pairs": [dataclasses.asdict(pair) for pair in check.pairs],
    }
