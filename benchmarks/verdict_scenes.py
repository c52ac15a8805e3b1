"""Simulated image sets of good and bad quality with known cameras, the test cases of the verdict.

Each kind is a clean set with one defect. The unit of length is a square of the board.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.convergence_scenes import LENSES, MIRRORS, SIZE, Lens
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis, cap, polar
from omnisight.images import ImageField
from omnisight.images.ellipse import Ellipse
from omnisight.models import CameraModel, model_class
from omnisight.targets import Checkerboard
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

BOARDS = (Checkerboard(7, 5), Checkerboard(9, 6), Checkerboard(11, 8))
# Radius of the image circle, px: inside the image, and around it.
INSIDE, AROUND = 470.0, 800.0
MIN_CORNERS, MAX_TRIES = 12, 200
# Number of rings of directions at which errors are evaluated.
RINGS = 14
# Periods of the radial distortion of an odd lens over its field.
WAVES = 1.7


@dataclass(frozen=True)
class Session:
    """Parameters of a simulated image set.

    Attributes
    ----------
    images, noise
        Number of images, and standard deviation of a corner coordinate, px.
    reach
        Part of the field of view, from its centre, that contains the boards.
    sector
        Azimuth and half width (radians) of the sector that contains the boards; None for all azimuths.
    tilt
        (low, high) tilt of a board from facing the camera, degrees; None for boards parallel to the sensor.
    share
        (low, high) angular size of a board divided by the field of view.
    bend, twist
        Warp of the board: height of its centre (along columns, rows) and of its corners, relative to its width.
    stretch
        Relative difference of the width and height of a square.
    wrong, slipped
        Part of the corners with errors up to 40 px; number of views with half of the corners shifted by one square.
    pupil
        Shift of the entrance pupil along the axis at 90 degrees.
    wave
        Largest deviation of the lens from every parametric model, px.
    sway
        Random rotation of the board during the readout of the rows, degrees.
    drift, zoom
        Random and steady change of the focal length between the images, relative.
    repeats
        Number of copies of each image.
    model
        Model to calibrate.
    """

    images: int
    noise: float
    reach: float = 1.0
    sector: tuple[float, float] | None = None
    tilt: tuple[float, float] | None = (15.0, 45.0)
    share: tuple[float, float] = (0.25, 0.5)
    bend: tuple[float, float] = (0.0, 0.0)
    twist: float = 0.0
    stretch: float = 0.0
    wrong: float = 0.0
    slipped: int = 0
    pupil: float = 0.0
    wave: float = 0.0
    sway: float = 0.0
    drift: float = 0.0
    zoom: float = 0.0
    repeats: int = 1
    model: str = "auto"


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


# Changes to a clean session by kind. The names seed the random numbers.
KINDS: dict[str, Callable[[np.random.Generator], Mapping[str, Any]]] = {
    "clean": lambda rng: {},
    "usual": lambda rng: {
        "bend": tuple(rng.normal(0, 0.001, 2)),
        "twist": rng.normal(0, 0.0005),
        "wrong": 0.002,
        "sway": 0.03,
        "drift": 0.0002,
    },
    "noisy": lambda rng: {"noise": rng.uniform(0.3, 1.0)},
    "few": lambda rng: {"images": int(rng.integers(3, 8))},
    "middle only": lambda rng: {"reach": rng.uniform(0.25, 0.6)},
    "one side": lambda rng: {"sector": (rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.9))},
    "parallel": lambda rng: {"tilt": None},
    "little tilt": lambda rng: {"tilt": (0.0, rng.uniform(3.0, 10.0))},
    "copies": lambda rng: {"images": int(rng.integers(1, 5)), "repeats": int(rng.integers(4, 8))},
    "tiny boards": lambda rng: {"share": (0.04, 0.1)},
    "bent board": lambda rng: {"bend": tuple(rng.normal(0, 0.01, 2)), "twist": rng.normal(0, 0.005)},
    "stretched print": lambda rng: {"stretch": _sign(rng) * rng.uniform(0.003, 0.02)},
    "wrong corners": lambda rng: {"wrong": rng.uniform(0.02, 0.12), "slipped": int(rng.integers(0, 3))},
    "viewpoint moves": lambda rng: {"pupil": rng.uniform(0.05, 0.5), "share": (0.3, 0.6)},
    "odd lens": lambda rng: {"wave": float(np.exp(rng.uniform(np.log(0.2), np.log(4.0))))},
    "forced model": lambda rng: {"model": str(rng.choice(("equidistant", "stereographic", "division", "unified")))},
    "sway": lambda rng: {"sway": float(np.exp(rng.uniform(np.log(0.05), np.log(1.0))))},
    "refocus": lambda rng: {"drift": rng.uniform(0.0005, 0.004), "zoom": rng.uniform(0, 0.004)},
}


@dataclass(frozen=True)
class Case:
    """One image set; its text is the seed of its random numbers."""

    kind: str
    seed: int

    def __str__(self) -> str:
        return f"{self.kind}/{self.seed}"


@dataclass(frozen=True)
class GroundTruth:
    """A known camera.

    Attributes
    ----------
    name
        Name of the lens.
    model
        Camera model without the following effects.
    blind, half
        Smallest and largest visible angle from the axis, radians.
    pupil
        Entrance pupil shift s(theta) = pupil (1 - cos(theta)).
    wave
        (3,) amplitudes of the radial deviation, px: along the radius, with one and with two periods in azimuth.
    phases
        (3,) their phases.
    """

    name: str
    model: CameraModel
    blind: float
    half: float
    pupil: float = 0.0
    wave: tuple[float, float, float] = (0.0, 0.0, 0.0)
    phases: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def project(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return pixels (N, 2) of points (N, 3), and whether they are visible."""
        seen_from = np.zeros_like(points)
        for _ in range(20 if self.pupil else 0):  # fixed point: the shift depends on the angle of the ray
            seen_from[:, 2] = self.pupil * (1 - np.cos(angle_from_axis(points - seen_from)))
        rays = points - seen_from
        pixels, valid = self.model.project_numpy(rays)
        theta, phi = angle_from_axis(rays), np.arctan2(rays[:, 1], rays[:, 0])
        along = theta / self.half
        rings, once, twice = self.wave
        radial = rings * np.sin(2 * np.pi * WAVES * along + self.phases[0])
        radial = radial + once * along**2 * np.cos(phi + self.phases[1])
        radial = radial + twice * along**2 * np.cos(2 * phi + self.phases[2])
        pixels = pixels + (radial * np.minimum(4 * along, 1))[:, None] * np.stack([np.cos(phi), np.sin(phi)], 1)
        inside = np.nan_to_num(pixels, nan=-9.0)
        valid = valid & (theta < self.half) & (theta > self.blind)
        return pixels, valid & ((inside > 0) & (inside < np.array(SIZE) - 1.0)).all(1)

    @property
    def circle(self) -> ImageField | None:
        """The image circle; None if it is larger than the image."""
        rim, _ = self.model.project_numpy(polar(np.full(2, self.half), np.array([0.0, np.pi])))
        radius = float(np.ptp(rim[:, 0])) / 2
        if radius > INSIDE + 1:
            return None
        centre = float(self.model.params[2]), float(self.model.params[3])
        hole = None
        if self.blind:
            edge, _ = self.model.project_numpy(polar(np.full(2, self.blind), np.array([0.0, np.pi])))
            within = float(np.ptp(edge[:, 0])) / 2
            hole = Ellipse(centre, (within, within), 0.0)
        return ImageField(SIZE, Ellipse(centre, (radius, radius), 0.0), hole)

    def field(self) -> tuple[Array, Array]:
        """Return bearings (N, 3) over the visible field, and the pixels (N, 2) of points at infinity."""
        bearings = cap(self.half, RINGS)
        pixels, shown = replace(self, pupil=0.0).project(bearings)
        return bearings[shown], pixels[shown]


def scene(case: Case) -> tuple[Session, GroundTruth, Observations]:
    """Simulate the corners of a case; deterministic."""
    rng = np.random.default_rng(zlib.crc32(str(case).encode()))
    usual = Session(int(rng.integers(15, 26)), float(np.exp(rng.uniform(np.log(0.05), np.log(0.3)))))
    session = replace(usual, **KINDS[case.kind](rng))
    truth = camera(session, rng)
    board = BOARDS[int(rng.integers(len(BOARDS)))]
    return session, truth, observe(session, truth, board, rng)


def camera(session: Session, rng: np.random.Generator) -> GroundTruth:
    """Draw a lens of 60 to 200 degrees or, in one of five cases, a mirror."""
    rim = AROUND if rng.random() < 0.5 else INSIDE
    fov = int(rng.choice([fov for fov in LENSES if fov <= 200]))
    if session.pupil:
        fov = max(fov, 140)
    names = [name for name, lens in LENSES[fov].items() if lens.model != "ocam" and not lens.blind_deg]
    name = str(rng.choice(names))
    lens = LENSES[fov][name]
    if rng.random() < 0.2 and not session.pupil:
        name = str(rng.choice([name for name, lens in MIRRORS.items() if lens.model != "ocam"]))
        lens, fov, rim = MIRRORS[name], 220, INSIDE
    half = np.radians(min(fov / 2, 85.0) if lens.model == "orthographic" else fov / 2)
    model = scaled(lens, float(half), rim, rng)
    wave = tuple(session.wave * rng.dirichlet((1.0, 1.0, 1.0)))
    phases = tuple(rng.uniform(0, 2 * np.pi, 3))
    return GroundTruth(f"{name} {fov}", model, np.radians(lens.blind_deg), float(half), session.pupil, wave, phases)


def scaled(lens: Lens, half: float, rim: float, rng: np.random.Generator) -> CameraModel:
    """Scale a lens to the radius of its image circle (px), with the axis near the image centre."""
    plain = {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0, **lens.shape}
    radius = model_class(lens.model).from_dict(plain).project_numpy(np.array([[np.sin(half), 0.0, np.cos(half)]]))[0]
    focal = rim / float(radius[0, 0])
    middle = np.array(SIZE) / 2 + rng.normal(0, 4.0, 2)
    found = {**plain, "fx": focal, "fy": focal, "cx": float(middle[0]), "cy": float(middle[1])}
    return model_class(lens.model).from_dict(found)


def observe(session: Session, truth: GroundTruth, board: Checkerboard, rng: np.random.Generator) -> Observations:
    """Place the boards and simulate the measured corners with the defects of the session."""
    points = board.points - board.points.mean(0)
    print_ = points * (1 + session.stretch, 1.0, 1.0)
    across, down = points[:, 0] / np.ptp(points[:, 0]) * 2, points[:, 1] / np.ptp(points[:, 1]) * 2
    off = session.bend[0] * (1 - across**2) + session.bend[1] * (1 - down**2) + session.twist * across * down
    print_[:, 2] = off * np.ptp(points[:, 0])
    focus = 1 + session.drift * rng.normal(size=session.images)
    focus += session.zoom * (np.arange(session.images) / max(session.images - 1, 1) - 0.5)
    slipped = set(rng.permutation(session.images)[: session.slipped].tolist())
    views, names = list[tuple[Array, Array]](), list[str]()
    for i in range(session.images):
        pixels, use = _seen(session, truth, print_, i, float(focus[i]), rng)
        ids = np.flatnonzero(use)
        whole = points
        if i in slipped:  # indices shifted by one square from the middle row on, so the last column is missing
            row, column = np.divmod(np.arange(len(points)), board.columns)
            ids = ids[(column[ids] < board.columns - 1) | (row[ids] < board.rows // 2)]
            whole = points + (row >= board.rows // 2)[:, None] * (1.0, 0.0, 0.0)
        for k in range(session.repeats):
            measured = pixels[ids] + rng.normal(0, session.noise, (len(ids), 2))
            bad = rng.random(len(ids)) < session.wrong
            measured[bad] += rng.uniform(-40, 40, (int(bad.sum()), 2))
            views.append((whole[ids], np.clip(measured, 0, np.array(SIZE) - 1.0)))
            names.append(f"{i}.{k}")
    points, corners = zip(*views, strict=True)
    observations = Observations.from_arrays(points, corners, size=SIZE, names=names)
    return replace(observations, field=truth.circle)


def _seen(
    session: Session, truth: GroundTruth, board: Array, i: int, focus: float, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Place a board in view; return its pixels (n, 2) and which of them are inside the image."""
    width = float(np.ptp(board[:, 0]))
    for attempt in range(MAX_TRIES):
        loose = attempt / MAX_TRIES
        angle = min(rng.uniform(*session.share) * 2 * truth.half, np.radians(75.0))
        distance = width / 2 / np.tan(angle / 2)
        last = max(session.reach * truth.half - 0.35 * angle, 0.05)
        theta = truth.blind + (last - truth.blind) * np.sqrt((i + rng.uniform(0, 1)) / session.images)
        phi = 2.4 * i + rng.uniform(-0.4, 0.4) * (1 + 5 * loose)
        if session.sector is not None:
            phi = session.sector[0] + rng.uniform(-1, 1) * session.sector[1]
        spin = so3.exp(np.array([0.0, 0.0, rng.uniform(-0.5, 0.5) + (i % 2) * np.pi / 2]))
        if session.tilt is None:
            theta = min(theta, np.radians(55.0)) * np.sqrt(rng.uniform(0.1, 1)) if loose else min(theta, 0.96)
            rotation, distance = spin, distance / np.cos(theta)
        else:
            about = rng.uniform(0, 2 * np.pi)
            lean = np.radians(rng.uniform(*session.tilt)) * np.array([np.cos(about), np.sin(about), 0.0])
            facing = so3.exp(theta * np.array([-np.sin(phi), np.cos(phi), 0.0]))
            rotation = facing @ spin @ so3.exp(lean)
        towards = distance * polar(np.array(theta), np.array(phi))
        pixels, use = truth.project(board @ rotation.T + towards)
        if session.sway:
            turn = rng.normal(size=3) * np.radians(session.sway)
            for _ in range(3):  # rolling shutter: each corner at the readout time of its row
                when = np.nan_to_num(pixels[:, 1]) / SIZE[1] - 0.5
                moved = np.einsum("nij,nj->ni", so3.exp(when[:, None] * turn), board @ rotation.T)
                pixels, use = truth.project(moved + towards)
        if (
            use.mean() >= 0.75 * (1 - loose)
            and use.sum() >= MIN_CORNERS
            and np.linalg.matrix_rank(_spread(board[use])) == 2
        ):
            centre = truth.model.params[2:4]
            return centre + focus * (pixels - centre), use
    raise ValueError(f"{truth.name}: no board pose satisfies the session")


def _spread(points: Array) -> Array:
    return points[:, :2] - points[:, :2].mean(0)
