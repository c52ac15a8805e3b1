"""Corners of boards seen by made-up lenses and mirrors, some of them nasty: what a calibration must start from.

The unit of length is a square of the board, taken as 30 mm where millimetres matter.
"""

import zlib
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.state import State
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel, model_class
from omnisight.models.ocam import Ocam
from omnisight.targets import Checkerboard
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

SIZE = (1280, 960)
RIM = 470.0  # px from the axis to the edge of the image's circle
ASIDE = 0.2 * SIZE[0]  # px, of an axis far from the image's middle
BOARD = Checkerboard(9, 6)
FEWEST = 12  # corners of a board in an image
MOST = 0.9  # part of a board's corners that a usual image shows, if the board can be held so
TRIES = 300
KB = {"k1": 0.02, "k2": -0.006, "k3": 0.001, "k4": -0.0002}
BROWN = {"k1": -0.12, "k2": 0.03, "p1": 1e-3, "p2": -5e-4, "k3": 0.0}
# The entrance pupil of a fisheye comes forward by some millimetres towards the rim.
PUPIL = 3.0 / 30.0


@dataclass(frozen=True)
class Lens:
    """A model with the parameters of its shape; the part around the axis (degrees) that a mirror hides in itself."""

    model: str
    shape: dict[str, float]
    blind_deg: float = 0.0


IDEAL = {name: Lens(name, {}) for name in ("equidistant", "equisolid", "stereographic", "orthographic")}
FISHEYES = {
    "kannala_brandt": Lens("kannala_brandt", KB),
    "double_sphere": Lens("double_sphere", {"xi": -0.2, "alpha": 0.6}),
    "ocam": Lens("ocam", KB),
}
MIRRORS = {
    "parabola": Lens("unified", {"xi": 1.0}, 25.0),
    "hyperbola": Lens("unified", {"xi": 0.9}, 20.0),
    "mirror_ocam": Lens("ocam", {}, 25.0),
}
WIDE = {name: IDEAL[name] for name in ("equidistant", "equisolid", "stereographic")} | FISHEYES
LENSES: dict[int, dict[str, Lens]] = {
    60: {
        "pinhole": Lens("pinhole", {}),
        "radial_tangential": Lens("radial_tangential", BROWN),
        "equidistant": IDEAL["equidistant"],
        "kannala_brandt": FISHEYES["kannala_brandt"],
    },
    100: {
        "pinhole": Lens("pinhole", {}),
        **IDEAL,
        "fov": Lens("fov", {"omega": 0.9}),
        "division": Lens("division", {"k": -0.2}),
    },
    140: {**IDEAL, "division": Lens("division", {"k": -0.25}), "unified": Lens("unified", {"xi": 0.9}), **FISHEYES},
    180: {**WIDE, "division": Lens("division", {"k": -0.25}), "hyperbola": MIRRORS["hyperbola"]},
    200: {**WIDE, "fov": Lens("fov", {"omega": 0.9}), "eucm": Lens("eucm", {"alpha": 0.62, "beta": 1.08})},
    240: {**WIDE, **MIRRORS},
    280: {"equidistant": IDEAL["equidistant"], "stereographic": IDEAL["stereographic"], **MIRRORS},
}
AXES = ("middle", "aside")
BOARDS = ("usual", "near", "past90", "parts", "narrow")


@dataclass(frozen=True)
class Cell:
    """One place of the matrix; its text names it, and seeds all that is random in it."""

    fov: int
    lens: str
    axis: str
    boards: str
    noise: float
    outliers: float
    views: int

    def __str__(self) -> str:
        return f"{self.fov}/{self.lens}/{self.axis}/{self.boards}/{self.noise:g}/{self.outliers:g}/{self.views}"

    @classmethod
    def parse(cls, text: str) -> "Cell":
        """Return the cell that a text describes."""
        fov, lens, axis, boards, noise, outliers, views = text.split("/")
        return cls(int(fov), lens, axis, boards, float(noise), float(outliers), int(views))


@dataclass(frozen=True)
class Scene:
    """What a cell gives to a calibration, and the truth.

    Attributes
    ----------
    views
        The corners, with noise and gross errors.
    state
        The true camera and poses.
    clean
        (N,) corners without a gross error.
    cone
        (M, 3) bearings over the part of the camera's cone where boards are, to fit other models over.
    """

    views: Observations
    state: State
    clean: NDArray[np.bool_]
    cone: Array


@cache
def camera(fov: int, name: str, centre: tuple[float, float]) -> CameraModel:
    """Return the lens of a field of view, with its image circle `RIM` px from the axis."""
    lens = LENSES[fov][name]
    if lens.model == "ocam":
        base = "kannala_brandt" if lens.shape else "unified"
        shape = lens.shape or {"xi": 0.95}
    else:
        base, shape = lens.model, lens.shape
    half = np.radians(min(fov / 2, 89.0) if base == "orthographic" else fov / 2)
    plain = {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0, **shape}
    rim = model_class(base).from_dict(plain).project_numpy(np.array([[np.sin(half), 0.0, np.cos(half)]]))[0]
    focal = RIM / rim[0, 0]
    model = model_class(base).from_dict({**plain, "fx": focal, "fy": focal, "cx": centre[0], "cy": centre[1]})
    if lens.model == "ocam":
        around = cone_of(np.radians(lens.blind_deg), half)
        model = next(Ocam.initial_models_of_degrees(around, model.project_numpy(around)[0], [4]))
    return model


def cone_of(least: float, most: float) -> Array:
    """Return bearings (M, 3) between two angles from the axis."""
    theta = np.linspace(max(least, 0.01), most, 20)[:, None]
    phi = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    parts = np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))
    return np.stack(parts, -1).reshape(-1, 3)


def scene(cell: Cell) -> Scene:
    """Make the corners of a cell; the same cell always gives the same."""
    rng = np.random.default_rng(zlib.crc32(str(cell).encode()))
    centre = np.array([642.3, 476.2])
    if cell.axis == "aside":
        turn = rng.uniform(0, 2 * np.pi)
        centre = centre + ASIDE * np.array([np.cos(turn), np.sin(turn)])
    model = camera(cell.fov, cell.lens, (float(centre[0]), float(centre[1])))
    blind = np.radians(LENSES[cell.fov][cell.lens].blind_deg)
    middle = BOARD.points.mean(0)
    sector = rng.uniform(0, 2 * np.pi), bool(rng.integers(2))
    shown, rotations, translations, reach = list[tuple[Array, Array]](), list[Array](), list[Array](), [np.pi, 0.0]
    for i in range(cell.views):
        for attempt in range(TRIES):
            rotation, translation = _held(cell, i, blind, sector, attempt / TRIES, rng)
            points = (BOARD.points - middle) @ rotation.T + translation
            # The pupil moves along the axis with the angle: these corners are not seen from one point.
            theta = angle_from_axis(points)
            seen_from = np.zeros_like(points)
            seen_from[:, 2] = PUPIL * np.sin(theta / 2) ** 2 * (cell.boards == "near")
            pixels, valid = model.project_numpy(points - seen_from)
            theta = angle_from_axis(points - seen_from)
            use = valid & (theta < np.radians(cell.fov / 2)) & (theta > blind)
            use &= ((np.nan_to_num(pixels, nan=-1.0) >= 0) & (pixels <= np.array(SIZE) - 1.0)).all(1)
            if cell.boards in ("usual", "past90") and use.mean() < MOST * (1 - attempt / TRIES):
                continue
            if cell.boards == "parts" and i % 3:
                use &= _part(rng)
            if (
                use.sum() >= FEWEST
                and np.linalg.matrix_rank(BOARD.points[use, :2] - BOARD.points[use, :2].mean(0)) == 2
            ):
                break
        else:
            raise ValueError(f"{cell}: no board can be held so")
        shown.append((BOARD.points[use], pixels[use]))
        rotations.append(rotation)
        translations.append(translation - rotation @ middle)
        reach = [min(reach[0], theta[use].min()), max(reach[1], theta[use].max())]
    clean, views = list[NDArray[np.bool_]](), list[tuple[Array, Array]]()
    for points, pixels in shown:
        good = rng.random(len(pixels)) >= cell.outliers
        anywhere = rng.uniform(0, np.array(SIZE) - 1.0, pixels.shape)
        noisy = np.clip(pixels + rng.normal(0, 1, pixels.shape) * cell.noise, 0, np.array(SIZE) - 1.0)
        views.append((points, np.where(good[:, None], noisy, anywhere)))
        clean.append(good)
    state = State(model, np.array(rotations), np.array(translations))
    observations = Observations.from_arrays(*zip(*views, strict=True), size=SIZE)
    return Scene(observations, state, np.concatenate(clean), cone_of(reach[0], reach[1]))


def _held(
    cell: Cell, i: int, blind: float, sector: tuple[float, bool], loose: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Hold a board towards a direction, tilted by 20 to 40 degrees; give its rotation and where its middle is.

    `loose`, from 0 to 1, how far it may be from its place: an axis far from the image's middle hides some places.
    """
    half = np.radians(cell.fov / 2)
    far = (6.0, 12.0) if cell.fov > 70 else (12.0, 20.0)
    distance = rng.uniform(*((far[0] / 2.2, far[0] / 1.5) if cell.boards == "near" else far))
    phi = 2.4 * i + rng.uniform(-1, 1) * (0.3 + np.pi * loose)
    low, high = blind, half
    if cell.boards == "past90":
        low = np.radians(97.0)
    if cell.boards == "narrow":
        if sector[1]:
            phi = sector[0] + rng.uniform(-0.6, 0.6)
        else:
            high = max(0.55 * half, blind + 0.5)
    share = rng.uniform(0, 1) if cell.boards == "narrow" else (i + rng.uniform(0, 1)) / cell.views
    middle = 0.6 if cell.boards == "past90" else 0.5
    theta = low + (high - low) * (np.sqrt(share) * (1 - loose) + middle * loose)
    towards = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    lean = rng.normal(size=2)
    lean *= rng.uniform(0.35, 0.7) / np.linalg.norm(lean)
    facing = so3.exp(theta * np.array([-np.sin(phi), np.cos(phi), 0.0]))
    spin = so3.exp(np.array([0.0, 0.0, rng.uniform(-3, 3)]))
    return facing @ spin @ so3.exp(np.array([*lean, 0.0])), distance * towards


def _part(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Show a rectangle of the board's corners, 4 x 3 of them or more."""
    columns, rows = int(rng.integers(4, BOARD.columns + 1)), int(rng.integers(3, BOARD.rows + 1))
    left, top = int(rng.integers(0, BOARD.columns - columns + 1)), int(rng.integers(0, BOARD.rows - rows + 1))
    x, y = BOARD.points[:, 0], BOARD.points[:, 1]
    return (x >= left) & (x < left + columns) & (y >= top) & (y < top + rows)
