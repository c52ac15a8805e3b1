"""The curve r(theta) of a camera, and drawings of it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnisight.camera import Camera


@dataclass(frozen=True)
class Profile:
    """Distance from the centre (px) against the angle from the axis (degrees), averaged over azimuths.

    Attributes
    ----------
    theta_deg, radius
        The curve, within the image.
    focal
        px per radian on the axis.
    centre
        Pixel of the axis.
    calibrated_deg
        How far corners were seen, or None.
    """

    theta_deg: Any
    radius: Any
    focal: float
    centre: tuple[float, float]
    calibrated_deg: float | None


def radial_profile(camera: Camera) -> Profile:
    """Follow the bearings of every azimuth from the axis to the image's edge."""
    limit = min(camera.model.theta_max, np.pi * 0.999)
    theta = np.linspace(0, limit, 400)[1:-1]
    azimuth = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    s, c = np.sin(theta)[:, None], np.cos(theta)[:, None]
    bearings = np.stack([s * np.cos(azimuth), s * np.sin(azimuth), c + 0 * azimuth], -1)
    middle, _ = camera.project([0.0, 0.0, 1.0])
    pixels, valid = camera.project(bearings)
    inside = valid & (camera.in_image(pixels) if camera.width else True)
    distance = np.where(inside, np.linalg.norm(pixels - middle, axis=-1), np.nan)
    shown = np.isfinite(distance).any(1)
    last = int(np.argmin(np.append(shown, False)))
    radius = np.nanmean(distance[:last], axis=1) if last else np.zeros(0)
    step, _ = camera.project([[1e-4, 0.0, 1.0], [0.0, 1e-4, 1.0]])
    focal = float(np.mean(np.linalg.norm(step - middle, axis=1)) / 1e-4)
    calibrated = None if camera.theta_max is None else float(np.degrees(camera.theta_max))
    return Profile(np.degrees(theta[:last]), radius, focal, (float(middle[0]), float(middle[1])), calibrated)


def to_text(profile: Profile, width: int = 64, height: int = 14) -> str:
    """Draw the curve in characters: `*` calibrated, `.` past it, `-` an equidistant lens of the same focal length."""
    if not len(profile.theta_deg):
        return "r(theta): nothing of it lies in the image"
    x_max, y_max = profile.theta_deg[-1], profile.radius.max()
    grid = [[" "] * width for _ in range(height)]
    for column in range(width):
        theta = (column + 0.5) / width * x_max
        ideal = profile.focal * np.radians(theta)
        if ideal < y_max:
            grid[height - 1 - int(ideal / y_max * (height - 1e-9))][column] = "-"
        radius = np.interp(theta, profile.theta_deg, profile.radius)
        known = profile.calibrated_deg is None or theta <= profile.calibrated_deg
        grid[height - 1 - min(int(radius / y_max * height), height - 1)][column] = "*" if known else "."
    lines = [f"{y_max:7.0f} |{''.join(grid[0])}"] + [f"        |{''.join(row)}" for row in grid[1:]]
    lines += ["      0 +" + "-" * width, f"         0{'theta from the axis, degrees':^{width - 6}}{x_max:.0f}"]
    return "\n".join(["radius, px  (* calibrated, . extrapolated, - equidistant)", *lines])


def to_svg(profile: Profile) -> str:
    """Draw the curve as SVG, the extrapolated part dashed, beside an equidistant lens of the same focal length."""
    x_max, y_max = float(profile.theta_deg[-1]), float(profile.radius.max())

    def path(theta: Any, radius: Any) -> str:
        points = (f"{60 + 520 * t / x_max:.1f},{340 - 300 * r / y_max:.1f}" for t, r in zip(theta, radius, strict=True))
        return " ".join(points)

    known = profile.theta_deg <= (profile.calibrated_deg if profile.calibrated_deg is not None else np.inf)
    ideal = profile.focal * np.radians(profile.theta_deg)
    shown = ideal <= y_max
    ticks = [t for t in range(0, 181, 15) if t <= x_max]
    marks = "".join(
        f'<line x1="{60 + 520 * t / x_max:.1f}" x2="{60 + 520 * t / x_max:.1f}" y1="340" y2="345" stroke="#555"/>'
        f'<text x="{60 + 520 * t / x_max:.1f}" y="362" text-anchor="middle">{t}</text>'
        for t in ticks
    )
    style = "font-family='sans-serif' font-size='13' fill='#333'"
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 620 400' {style}>"
        "<rect width='620' height='400' fill='white'/>"
        "<path d='M60 40 V340 H580' fill='none' stroke='#555'/>"
        f"{marks}<text x='320' y='388' text-anchor='middle'>angle from the axis, degrees</text>"
        f"<text x='55' y='45' text-anchor='end'>{y_max:.0f}</text><text x='55' y='344' text-anchor='end'>0</text>"
        "<text x='60' y='28'>radius, px: calibrated, extrapolated (dashed), equidistant lens (thin)</text>"
        f"<polyline points='{path(profile.theta_deg[shown], ideal[shown])}' fill='none' stroke='#999'/>"
        f"<polyline points='{path(profile.theta_deg, profile.radius)}' fill='none' stroke='#c33' stroke-width='2'"
        " stroke-dasharray='5 5'/>"
        f"<polyline points='{path(profile.theta_deg[known], profile.radius[known])}' fill='none' stroke='#06c'"
        " stroke-width='3'/></svg>\n"
    )
