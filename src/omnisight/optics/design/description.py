"""Text descriptions of a mirror design, for reports and drawings."""

import numpy as np

from omnisight.optics.design.mirror_design import MirrorDesign
from omnisight.optics.design.performance import Performance
from omnisight.optics.design.tolerances import MAX_ERROR_PX, Tolerances
from omnisight.optics.mirrors.conic import Conic


def format_length(metres: float) -> str:
    """Return a length in a readable unit."""
    if abs(metres) < 5e-10:
        return "0"
    if abs(metres) < 1e-3:
        return f"{metres * 1e6:.3g} um"
    return f"{metres * 1e3:.4g} mm" if abs(metres) < 1 else f"{metres:.4g} m"


def describe_shape(design: MirrorDesign) -> str:
    """Return the parameters of the mirror's shape."""
    mirror = design.mirror
    if not isinstance(mirror, Conic):
        return f"half angle {np.degrees(mirror.half_angle):.3f} degrees"
    radius = f"convex, vertex radius {1e3 * mirror.radius:.6g} mm"
    e = mirror.eccentricity
    if e <= 1:
        return radius + (f", eccentricity {e:g}, conic constant {-e * e:g}" if e else "")
    a = mirror.radius / (e * e - 1)
    axes = f"a {format_length(a)}, b {format_length(a * np.sqrt(e * e - 1))}, c {format_length(a * e)}"
    return f"{radius}, eccentricity {e:.6g}, conic constant {-e * e:.6g} ({axes})"


def describe_lens(design: MirrorDesign) -> str:
    """Return the type of the lens and its position."""
    distance = format_length(design.distance)
    if design.focal is None:
        size = f"{format_length(2 * design.mirror.rim)} wide, magnification {design.magnification:.4g}"
        return f"telecentric, {size}; {distance} from the vertex, or anywhere on the axis"
    angle = 2 * np.degrees(np.arctan(design.circle * design.specification.pixel / design.focal))
    focal = f"focal length {format_length(design.focal)}, {angle:.1f} degrees across the mirror"
    return f"{focal}; entrance pupil {distance} from the vertex"


def describe_field(design: MirrorDesign, performance: Performance) -> str:
    """Return the elevations in view."""
    up, down = np.round([np.degrees(design.specification.up), 90 - np.degrees(performance.blind.theta)], 1)
    upper, lower = ("above" if up >= 0 else "below"), ("below" if down >= 0 else "above")
    return f"from {abs(up):.1f} degrees {upper} the horizon to {abs(down):.1f} {lower} it"


def describe_blind_spot(design: MirrorDesign, performance: Performance) -> str:
    """Return the size and the cause of the blind spot."""
    blind = performance.blind
    angle = f"{np.degrees(blind.theta):.1f} degrees around straight down"
    if blind.radius == 0:
        return f"{angle}, outside the field of the mirror"
    cause = "the hole of the mirror" if blind.radius == design.image_radius(design.mirror.hole) else "the camera itself"
    return f"{angle}, {2 * blind.radius:.0f} px across: {cause}"


def surface_equation(design: MirrorDesign) -> str:
    """Return the equation of the surface: the sag z behind the vertex at a distance rho from the axis, mm."""
    mirror = design.mirror
    if not isinstance(mirror, Conic):
        return f"z = ρ · {float(mirror.sag(1.0)):.6g}"
    radius, share = 1e3 * mirror.radius, (1 - mirror.eccentricity**2) / (1e3 * mirror.radius) ** 2
    if share == 0:
        return f"z = ρ²/{2 * radius:.6g}"
    return f"z = ρ²/({radius:.6g}·(1 + √(1 {'-' if share > 0 else '+'} {abs(share):.6g}·ρ²)))"


def describe_tolerances(design: MirrorDesign, tolerances: Tolerances) -> list[tuple[str, str]]:
    """Return the tolerances as rows of name and text."""

    def displacement(metres: float) -> str:
        if np.isnan(metres):
            return "not computed"
        return f"±{1e3 * metres:.2g} mm" if metres < design.mirror.rim else "not critical"

    return [
        ("axial position", displacement(tolerances.axial)),
        ("lateral position", displacement(tolerances.lateral)),
        ("tilt", f"±{np.degrees(tolerances.tilt):.2g}°"),
        ("surface slope", f"±{np.degrees(tolerances.slope) * 60:.2g}′"),
    ]


def describe_tolerance_limits(design: MirrorDesign) -> list[str]:
    """Return what the tolerances keep, in short lines."""
    distance = format_length(design.specification.working_distance)
    return [f"Each causes at most {MAX_ERROR_PX} px", f"at {distance}; the mirror's image", "stays on the sensor."]
