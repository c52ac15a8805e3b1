"""omnisight design."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter


def design(
    what: Literal["mirror"],
    /,
    *,
    kind: str = "hyperbolic",
    hfov: float = 360.0,
    up: float = 20.0,
    down: float = 60.0,
    sensor: str = "1280x960",
    pixel: str = "3.75um",
    focal: str | None = None,
    diameter: str | None = None,
    distance: str | None = None,
    body: str = "30mm",
    working_distance: str = "1m",
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    camera: Path | None = None,
    json: bool = False,
) -> None:
    """Design a camera that looks into a mirror above it and sees all around.

    Give the field of view and the sensor, and what is fixed of the sizes; the rest follows:

        omnisight design mirror --up 20 --down 60
        omnisight design mirror --up 10 --down 50 --sensor 1920x1080 --pixel 3um --focal 8mm --diameter 50mm
        omnisight design mirror --kind parabolic --up 15 --diameter 40mm -o mirror.svg --camera camera.json

    Two of focal length, diameter and distance settle the third. With one or none of them, the lens sees the mirror
    within 40 degrees, and the mirror is 60 mm wide.

    Parameters
    ----------
    what
        mirror.
    kind
        hyperbolic, parabolic (needs a telecentric lens), spherical or conical (both without a single viewpoint).
    hfov
        Field around, degrees. A mirror of revolution shows all 360.
    up
        How far the image is to reach above the horizon, degrees.
    down
        And below it; straight down is the camera itself.
    sensor
        WIDTHxHEIGHT, px.
    pixel
        Side of a pixel with its unit: 3.75um.
    focal
        Focal length of the lens with its unit: 8mm.
    diameter
        Of the mirror's rim: 60mm.
    distance
        From the lens' centre, which is its entrance pupil, to the mirror's vertex: 80mm.
    body
        Diameter of the camera, as the mirror sees it: it hides what is behind it. A telecentric lens is as wide as its
        mirror at least.
    working_distance
        How far things are: what a mirror out of its place costs there is told.
    output
        An SVG of the cross section, and of the resolution.
    camera
        The camera file of the design, for `omnisight simulate` and the rest: the unified model of one with a single
        viewpoint, for `omnisight view` too; the lens and its mirror of another.
    json
        Print one JSON object and nothing else.
    """
    del what
    from omnisight.cli._design_report import as_json, print_report
    from omnisight.optics.design.mirror_design import design_mirror
    from omnisight.optics.design.performance import evaluate_design

    if hfov != 360:
        raise ValueError(
            f"--hfov is {hfov:g}: a mirror of revolution shows all 360 degrees around. Leave it at 360, and cut out"
            " what you need of the panorama: omnisight view --to cylinder --azimuth -90:90"
        )
    for file, suffix in ((output, ".svg"), (camera, ".json")):
        if file is not None:
            _must_be(file, suffix)
    made = design_mirror(_order(kind, up, down, sensor, pixel, focal, diameter, distance, body, working_distance))
    shown = evaluate_design(made)
    written = _camera(made, shown) if camera is not None else None
    if json:
        as_json(made, shown)
    else:
        print_report(made, shown)
    if output is not None:
        from omnisight.images import write_bytes
        from omnisight.report.drawings.mirror_design import draw_design

        write_bytes(output, draw_design(made, shown).encode())
        if not json:
            print(f"drawn       {output}")
    if camera is not None and written is not None:
        from omnisight.formats import save

        save(written, camera, format="native")
        if not json:
            more = f"upright panoramas: omnisight view PICTURE --camera {camera} --up back"
            if not made.central:
                more = f"rendered images: omnisight simulate room --camera {camera}"
            print(f"written     {camera}; {more}")


def _order(
    kind: str,
    up: float,
    down: float,
    sensor: str,
    pixel: str,
    focal: str | None,
    diameter: str | None,
    distance: str | None,
    body: str,
    working_distance: str,
) -> Any:
    """Read what was asked for."""
    import numpy as np

    from omnisight.optics.design.specification import MirrorSpecification

    def length(name: str, text: str | None) -> float | None:
        return None if text is None else _length(name, text)

    return MirrorSpecification(
        kind,
        float(np.radians(up)),
        float(np.radians(down)),
        _sensor(sensor),
        _length("--pixel", pixel),
        length("--focal", focal),
        length("--diameter", diameter),
        length("--distance", distance),
        _length("--body", body),
        _length("--working-distance", working_distance),
    )


def _sensor(text: str) -> tuple[int, int]:
    from omnisight.cli._size import parse_size

    try:
        return parse_size(text)
    except ValueError as error:
        raise ValueError(str(error).replace("--size", "--sensor")) from None


def _length(name: str, text: str) -> float:
    from omnisight.targets.length import parse_length

    try:
        return parse_length(text)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _must_be(file: Path, suffix: str) -> None:
    """Refuse, before any work, a file that could not be written, or of another kind."""
    from omnisight.cli._files import must_be_writable

    must_be_writable(file)
    if file.suffix.lower() != suffix:
        raise ValueError(f"{file}: what is written is {suffix}; name it {file.stem}{suffix}")


def _camera(made: Any, shown: Any) -> Any:
    """Give the camera of a design: of a central one its model, of another its lens and mirror, to be traced."""
    from omnisight.camera import Camera
    from omnisight.pipeline.provenance import tool_provenance
    from omnisight.ray_camera import RayCamera

    source = tool_provenance() | {"source": f"omnisight design mirror --kind {made.specification.kind}"}
    if not made.central:
        # In the lens' frame, whose z looks up into the mirror.
        limits = {"theta_max": math.pi - shown.blind.theta, "theta_min": math.pi - made.specification.theta}
        return RayCamera(made.system(), made.specification.size, provenance=source, **limits)
    limits = {"theta_max": made.specification.theta, "theta_min": shown.blind.theta}
    return Camera(made.model(), made.specification.size, provenance=source, **limits)
