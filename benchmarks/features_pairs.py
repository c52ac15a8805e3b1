"""Rendered pairs of images with known poses, for the benchmark of features."""

import dataclasses
import hashlib
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import omnisight as om
from omnisight.cache import cache_folder
from omnisight.features import Keypoints, Matches
from omnisight.geometry import rotation as so3
from omnisight.simulation import CameraSetup, Renderer, Scene, fisheye_setup, mirror_setup, scene_named
from omnisight.views.maps import resolution

Array = NDArray[np.float64]

# Rotation vectors, degrees, in the frame of the camera.
TURNS = {"none": (0, 0, 0), "yaw 50°": (0, 50, 0), "pitch 50°": (50, 0, 0), "roll 50°": (0, 0, 50)}
MOVES = (
    *((baseline, "none") for baseline in (0.1, 0.3, 1.0, 3.0)),
    *((baseline, turn) for turn in ("yaw 50°", "pitch 50°", "roll 50°") for baseline in (0.3, 1.0)),
)
QUICK_MOVES = ((0.3, "none"), (1.0, "none"), (0.3, "pitch 50°"))
CORRECT_PX = 3.0


def cameras() -> dict[str, CameraSetup]:
    """Return cameras that see 190 degrees, all around below the horizon, and everything."""
    return {
        "fisheye": _calibrated(fisheye_setup(960)),
        "mirror": _calibrated(mirror_setup(960)),
        "sphere": CameraSetup(om.sphere(1440), om.Pose(), (0.0, np.pi)),
    }


def _calibrated(setup: CameraSetup) -> CameraSetup:
    low, high = setup.theta
    return dataclasses.replace(setup, camera=dataclasses.replace(setup.camera, theta_min=low, theta_max=high))


@dataclass(frozen=True, eq=False)
class Shot:
    """A rendered image and its renderer."""

    image: NDArray[np.uint8]
    renderer: Renderer

    @property
    def camera(self) -> om.Camera:
        return self.renderer.camera

    @property
    def pose(self) -> om.Pose:
        return self.renderer.world_from_cam


@dataclass(frozen=True, eq=False)
class Pair:
    """Two images; `baseline` in metres and the name of the rotation between them."""

    scene: str
    camera: str
    baseline: float
    turn: str
    a: Shot
    b: Shot

    @property
    def b_from_a(self) -> om.Pose:
        return self.b.pose.inverse() @ self.a.pose


@cache
def free_region(scene: str) -> tuple[Array, Array]:
    """Return the lower and upper corner of the region of a scene without objects."""
    low, high = np.array(_scene(scene).free)
    return low, high


@cache
def _scene(name: str) -> Scene:
    return scene_named(name)


def shoot(scene: str, setup: CameraSetup, baseline: float, turn: str) -> Shot:
    """Render an image from a place on the diagonal of the scene's free region, or read it from the cache."""
    low, high = free_region(scene)
    along = (high - low) / np.linalg.norm(high - low)
    rotation = setup.world_from_cam.rotation @ so3.exp(np.radians(TURNS[turn]))
    return shoot_at(scene, setup, om.Pose(rotation, low + 0.05 * (high - low) + baseline * along))


def shoot_at(scene: str, setup: CameraSetup, world_from_cam: om.Pose) -> Shot:
    """Render an image from a pose, or read it from the cache."""
    renderer = Renderer(setup.camera, world_from_cam, _scene(scene), theta=setup.theta)
    pose = world_from_cam.rotation.tolist(), world_from_cam.translation.tolist()
    key = repr((scene, setup.camera.model, setup.camera.size, setup.theta, pose))
    path = _folder() / f"{hashlib.sha256(key.encode()).hexdigest()[:16]}.png"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        seed = np.random.default_rng(int(path.stem[:8], 16))
        om.write_image(path, renderer(rng=seed).image)
    return Shot(om.read_image(path), renderer)


def _folder() -> Path:
    folder = cache_folder()
    return (folder if folder.exists() else Path(tempfile.gettempdir())) / "benchmark-pairs"


def pairs(quick: bool) -> list[Pair]:
    """Return the pairs of all scenes, cameras and moves, and pairs of a fisheye and a mirror."""
    scenes, moves, setups = ("room",) if quick else ("room", "street"), QUICK_MOVES if quick else MOVES, cameras()
    same = [
        Pair(scene, name, baseline, turn, shoot(scene, setup, 0.0, "none"), shoot(scene, setup, baseline, turn))
        for scene in scenes
        for name, setup in setups.items()
        for baseline, turn in moves
    ]
    first, second = setups["fisheye"], setups["mirror"]
    mixed = [
        Pair(
            scene,
            "fisheye and mirror",
            at,
            "other camera",
            shoot(scene, first, 0.0, "none"),
            shoot(scene, second, at, "none"),
        )
        for scene in scenes
        for at in (0.3, 1.0)
    ]
    return same + mixed


@dataclass(frozen=True)
class Score:
    """Result of a pair.

    Attributes
    ----------
    keypoints
        Number in the first image.
    repeatability
        Share of those visible in the second image that were detected there within 3 px.
    matches, correct
        Number of matches whose scene point is known, and of those within 3 px of the truth.
    errors
        (correct,) their angles to the truth, radians.
    normalized
        (correct,) squared errors over their covariance (2 degrees of freedom).
    px
        Pixels per radian of the camera.
    """

    keypoints: int
    repeatability: float
    matches: int
    correct: int
    errors: Array
    normalized: Array
    px: float


def evaluate(pair: Pair, a: Keypoints, b: Keypoints, matches: Matches) -> Score:
    """Compare matches with the depth and the poses of the renderer."""
    px = float(np.median(resolution(pair.b.camera, pair.b.camera.samples()[0])))
    limit = CORRECT_PX / px
    truth, visible, known = true_bearings(pair, a.bearings)
    found = cKDTree(b.bearings).query(truth[visible])[0] < limit
    i, j = matches.pairs[known[matches.pairs[:, 0]]].T
    error = np.where(visible[i], np.linalg.norm(truth[i] - b.bearings[j], axis=1), np.inf)
    good = error < limit
    return Score(
        len(a),
        float(found.mean()) if found.size else np.nan,
        len(i),
        int(good.sum()),
        error[good],
        _normalized(pair, a, b, i[good], j[good], truth),
        px,
    )


def true_bearings(pair: Pair, bearings: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return bearings (N, 3) of the first image in the second, whether they are visible, and not in the sky."""
    pose = pair.a.pose
    directions = bearings @ pose.rotation.T
    depth = pair.a.renderer.scene.cast(pose.translation, directions).distances
    points = pose.translation + depth[:, None] * directions
    _, visible = pair.b.renderer.locate(points)
    in_b = pair.b.pose.inverse() @ points
    return in_b / np.linalg.norm(in_b, axis=1, keepdims=True), visible, np.isfinite(depth)


def _normalized(
    pair: Pair, a: Keypoints, b: Keypoints, i: NDArray[np.intp], j: NDArray[np.intp], truth: Array
) -> Array:
    """Return squared errors in units of their covariance: that of `a`, mapped by differences, plus that of `b`."""
    step = 1e-5
    u = np.cross(a.bearings[i], np.eye(3)[np.abs(a.bearings[i]).argmin(1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    tangents = np.stack([u, np.cross(a.bearings[i], u)], 1)
    moved = [true_bearings(pair, _unit(a.bearings[i] + step * tangents[:, k]))[0] for k in range(2)]
    d_truth = np.stack([(m - truth[i]) / step for m in moved], -1)
    in_tangents = np.einsum("nki,nij,nlj->nkl", tangents, a.covariance[i], tangents)
    covariance = d_truth @ in_tangents @ d_truth.transpose(0, 2, 1) + b.covariance[j]
    known = np.isfinite(covariance).all((1, 2))  # the differences do not reach the sky
    difference = (b.bearings[j] - truth[i])[known]
    return np.einsum("ni,nij,nj->n", difference, np.linalg.pinv(covariance[known], rcond=1e-4), difference)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
