"""Calibration from lines on rendered images with known cameras.

`python -m benchmarks.lines rendered [tuning|test] [name ...]`. Tune constants on the cameras of the tuning half and
evaluate them on the test half.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.lines import (
    LineObservations,
    LinesCalibration,
    PixelChains,
    bearing_difference,
    detect_arcs,
)
from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.images import estimate_image_field, to_gray8
from omnisight.models import CameraModel
from omnisight.models.double_sphere import DoubleSphere
from omnisight.models.equidistant import Equidistant
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.models.radial_polynomial import RadialPolynomial
from omnisight.models.unified import Unified
from omnisight.pipeline.calibration.calibrate_lines import calibrate_lines
from omnisight.simulation import Renderer, scene_named

Bytes = NDArray[np.uint8]

# Radius of the aperture as a share of the image circle's, and standard deviation of its centre per axis as a share of
# the radius, as for four real cameras (0.4 %, see BORDER_CENTRE_SIGMA).
APERTURE_SHARE, APERTURE_CENTRE_SIGMA = 0.98, 0.0045
SCENES = ("room", "street", "lines")
COUNTS = (1, 3)


@dataclass(frozen=True)
class Subject:
    """A camera to estimate from lines.

    Attributes
    ----------
    name
        Name in the tables.
    half
        tuning or test.
    model, size
        True model and image size (width, height).
    theta_deg
        Smallest and largest visible angle off-axis, degrees.
    sensor
        Blur (px), noise (of 255) and JPEG quality.
    """

    name: str
    half: str
    model: CameraModel
    size: tuple[int, int]
    theta_deg: tuple[float, float]
    sensor: tuple[float, float, int]

    @property
    def mirror(self) -> bool:
        """Whether the camera looks into a mirror, which shows the camera itself in the centre."""
        return self.theta_deg[0] > 0

    def images(self, scene: str, count: int, seed: int) -> list[Bytes]:
        """Render gray images (H, W) of a scene from random poses."""
        rng = np.random.default_rng(seed)
        place = scene_named(scene, seed % 2)
        low, high = np.array(place.free)
        blur, noise, jpeg = self.sensor
        grays: list[Bytes] = []
        for _ in range(count):
            yaw, lean = so3.exp((0, rng.uniform(0, 2 * np.pi), 0)), so3.exp(np.radians(5) * rng.normal(size=3))
            turn = yaw @ so3.look(up="back" if self.mirror else "top") @ lean
            renderer = Renderer(
                Camera(self.model, self.size),
                Pose(turn, low + (high - low) * rng.uniform(size=3)),
                place,
                theta=(np.radians(self.theta_deg[0]), np.radians(self.theta_deg[1])),
            )
            grays.append(self.with_aperture(to_gray8(renderer(rng=rng, blur=blur, noise=noise, jpeg=jpeg).image)))
        return grays

    def with_aperture(self, gray: Bytes) -> Bytes:
        """Mask the image (H, W) outside a circular aperture that is slightly decentred, as in real cameras."""
        if self.theta_deg[1] >= 180:
            return gray
        values, theta = self.model.to_dict(), np.radians(self.theta_deg[1])
        centre = np.array((values["cx"], values["cy"]))
        rim = self.model.project_numpy(np.array([[0.0, np.sin(theta), np.cos(theta)]]))[0][0]
        radius = float(np.linalg.norm(rim - centre))
        centre += APERTURE_CENTRE_SIGMA * radius * np.random.default_rng(zlib.crc32(self.name.encode())).normal(size=2)
        away = np.linalg.norm(np.stack(np.meshgrid(*(np.arange(n) for n in self.size)), -1) - centre, axis=-1)
        return np.rint(gray * np.clip(APERTURE_SHARE * radius - away + 0.5, 0, 1)).astype(np.uint8)


def unified(size: tuple[int, int], radius: float, theta_deg: float, aside: tuple[float, float], xi: float) -> Unified:
    """Return a unified camera that shows `theta_deg` at `radius` px, with its centre shifted by `aside` px."""
    focal = radius * (np.cos(np.radians(theta_deg)) + xi) / np.sin(np.radians(theta_deg))
    flip = -1 if xi <= 1 else 1
    return Unified(flip * focal, focal, size[0] / 2 + aside[0], size[1] / 2 + aside[1], xi)


def _mirror(
    half: str,
    name: str,
    size: tuple[int, int],
    xi: float,
    aside: tuple[float, float],
    low: float,
    high: float,
    sensor: tuple[float, float, int],
) -> Subject:
    model = unified(size, 0.47 * min(size), high, aside, xi)
    return Subject(name, half, model, size, (low, high), sensor)


SUBJECTS = (
    _mirror("tuning", "parabolic", (1024, 768), 1.0, (9, -6), 20, 105, (0.8, 2.0, 92)),
    _mirror("tuning", "parabolic small", (640, 480), 1.0, (-22, 14), 15, 95, (0.7, 1.5, 90)),
    _mirror("tuning", "hyperbolic 0.75", (1280, 960), 0.75, (14, 10), 22, 110, (0.9, 2.5, 90)),
    _mirror("tuning", "hyperbolic 0.9", (800, 800), 0.90, (-6, 5), 18, 100, (0.8, 2.0, 85)),
    Subject("unified 1.6, 170", "tuning", Unified(640, 640, 655, 470, 1.6), (1280, 960), (0, 85), (0.9, 2.0, 92)),
    Subject(
        "double sphere 185",
        "tuning",
        DoubleSphere(376, 376, 652, 497, -0.17, 0.59),
        (1280, 1024),
        (0, 92.5),
        (0.8, 2.0, 90),
    ),
    Subject("equidistant 180", "tuning", Equidistant(318, 318, 520, 506), (1024, 1024), (0, 90), (0.7, 3.0, 88)),
    Subject("equidistant 140", "tuning", Equidistant(520, 520, 630, 368), (1280, 720), (0, 180), (0.9, 1.5, 95)),
    # The lens of Intel's T265: its factory's k, at another focal length.
    Subject(
        "kannala-brandt 163",
        "tuning",
        KannalaBrandt(540, 540, 811, 588, -0.0080, 0.0425, -0.0405, 0.0073),
        (1600, 1200),
        (0, 81.5),
        (1.0, 2.0, 92),
    ),
    Subject(
        "kannala-brandt 200",
        "tuning",
        KannalaBrandt(255, 255, 476, 487, 0.0035, 0.0007, -0.0021, 0.0002),
        (960, 960),
        (0, 98),
        (0.8, 2.0, 90),
    ),
    Subject(
        "kannala-brandt 150",
        "tuning",
        KannalaBrandt(690, 690, 967, 531, -0.032, -0.006, 0.002, 0.0),
        (1920, 1080),
        (0, 180),
        (0.9, 2.5, 88),
    ),
    _mirror("tuning", "hyperbolic 0.83", (1600, 1200), 0.83, (30, -18), 16, 98, (1.0, 3.0, 90)),
    _mirror("test", "parabolic", (1280, 1024), 1.0, (-16, 11), 18, 100, (0.9, 2.5, 90)),
    _mirror("test", "parabolic small", (720, 576), 1.0, (18, 9), 22, 108, (0.7, 2.0, 92)),
    _mirror("test", "hyperbolic 0.8", (1024, 1024), 0.80, (-11, -8), 20, 104, (0.8, 2.0, 88)),
    _mirror("test", "hyperbolic 0.95", (1600, 1200), 0.95, (12, 20), 16, 96, (1.0, 2.0, 92)),
    Subject("unified 1.9, 160", "test", Unified(860, 860, 790, 612, 1.9), (1600, 1200), (0, 80), (0.8, 2.0, 90)),
    Subject(
        "double sphere 195",
        "test",
        DoubleSphere(270, 270, 473, 486, -0.22, 0.57),
        (960, 960),
        (0, 97.5),
        (0.8, 2.5, 90),
    ),
    Subject("equidistant 200", "test", Equidistant(262, 262, 633, 487), (1280, 960), (0, 100), (0.9, 2.0, 92)),
    Subject("equidistant 150", "test", Equidistant(455, 455, 645, 482), (1280, 960), (0, 180), (0.7, 1.5, 85)),
    # The lens of the demonstration, and the front camera of Valeo's WoodScape.
    Subject(
        "kannala-brandt 190",
        "test",
        KannalaBrandt(296, 296, 644, 476, -0.018, 0.0031, -0.0016, 0.0001),
        (1280, 960),
        (0, 95),
        (0.8, 2.0, 90),
    ),
    Subject(
        "polynomial 180",
        "test",
        RadialPolynomial(339.7, 339.7, 643.9, 479.6, -0.0942, 0.1421, -0.0212),
        (1280, 966),
        (0, 90),
        (0.9, 2.0, 90),
    ),
    Subject(
        "kannala-brandt 140",
        "test",
        KannalaBrandt(560, 560, 952, 549, 0.045, -0.021, 0.006, -0.0007),
        (1920, 1080),
        (0, 70),
        (1.0, 2.5, 92),
    ),
    _mirror("test", "hyperbolic 0.88", (800, 600), 0.88, (-15, 6), 18, 106, (0.8, 1.5, 90)),
)


@dataclass(frozen=True)
class Outcome:
    """Difference from the truth and stated standard deviation over the pixels of the lines, degrees."""

    lines: int
    difference: float
    stated: float

    @property
    def ratio(self) -> float:
        """The difference divided by the stated standard deviation."""
        return self.difference / self.stated


def observe(grays: Sequence[Bytes], size: tuple[int, int]) -> LineObservations:
    """Detect arcs as `omnisight calibrate-lines` does."""
    field = estimate_image_field(grays)
    arcs = [(arc, i) for i, gray in enumerate(grays) for arc in detect_arcs(gray, field)]
    centre = None if field.outer is None else np.array(field.outer.centre)
    return LineObservations(PixelChains.from_arrays([a for a, _ in arcs], [i for _, i in arcs]), size, centre)


def difference(found: LinesCalibration, truth: CameraModel) -> float:
    """Return the bearing difference from the truth, degrees, rms over the lines' pixels.

    Lines do not determine handedness, the sign of fx, so the truth is compared with a positive fx.
    """
    values = truth.to_dict()
    values["fx"] = abs(values["fx"])
    same = truth.with_params([values[name] for name in truth.param_names])
    return float(np.degrees(bearing_difference(found.camera.model, same, found.lines.subsample(150).pixels)))


def attempt(subject: Subject, grays: Sequence[Bytes]) -> Outcome | str:
    """Detect arcs and calibrate; return the error message if that fails."""
    try:
        found = calibrate_lines(observe(grays, subject.size))
    except ValueError as error:
        return str(error)
    return Outcome(len(found.lines), difference(found, subject.model), float(np.degrees(found.bearing_sigma)))


def runs(half: str, only: Sequence[str] = ()) -> Iterator[tuple[Subject, str, int, int]]:
    """Yield each camera of a half with two scenes, one and three images, and the seed of their poses."""
    for i, subject in enumerate(s for s in SUBJECTS if s.half == half):
        if not only or subject.name.startswith(tuple(only)):
            for j, count in enumerate(COUNTS):
                yield subject, SCENES[(i + j) % len(SCENES)], count, 100 * (half == "test") + 10 * i + j


def report(arguments: Sequence[str]) -> None:
    """Print the tables of the named halves and cameras, by default all."""
    halves = [half for half in ("tuning", "test") if half in arguments] or ["tuning", "test"]
    only = [name for name in arguments if name not in halves]
    for half in halves:
        print(f"\n**{half}**\n\n| camera | scene | images | lines | difference deg | stated deg | ratio |")
        print("|---|---|---|---|---|---|---|")
        outcomes: list[Outcome] = []
        for subject, scene, count, seed in runs(half, only):
            got = attempt(subject, subject.images(scene, count, seed))
            about = f"| {subject.name} | {scene} | {count} |"
            if isinstance(got, str):
                print(f"{about} refused: {got} | | | |", flush=True)
                continue
            outcomes.append(got)
            print(f"{about} {got.lines} | {got.difference:.2f} | {got.stated:.2f} | {got.ratio:.2f} |", flush=True)
        if outcomes:
            ratio = np.array([o.ratio for o in outcomes])
            off, said = (np.median([getattr(o, name) for o in outcomes]) for name in ("difference", "stated"))
            print(
                f"\n{len(ratio)} calibrations: difference {off:.2f} degrees in the median, stated {said:.2f}; ratio"
                f" {np.median(ratio):.2f} in the median, above 1 in {(ratio > 1).sum()}, above 2 in"
                f" {(ratio > 2).sum()}, at most {ratio.max():.1f}"
            )
