"""Rigs with exact board corners, noise and outliers: truth for the calibration of rigs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnisight import Checkerboard, Observations, Pose, Rig, look
from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.models import model_class
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.models.radial_tangential import RadialTangentialPinhole
from omnisight.rig import Sensor
from omnisight.simulation.example_rigs import back_to_back, ladybug, surround_car

# Corners of a board below which a view is not detected.
MIN_CORNERS = 12
MARGIN_PX = 4.0
MAX_ATTEMPTS = 4000
OUTLIER_PX = 30.0


@dataclass(frozen=True)
class RigScene:
    """A true rig and the boards that it observes.

    Attributes
    ----------
    rig
        The true rig.
    board
        The board.
    rig_from_board
        Its poses.
    """

    rig: Rig
    board: Checkerboard
    rig_from_board: Sequence[Pose]

    def observe(
        self, rng: np.random.Generator, noise_px: float = 0.3, outliers: float = 0.05
    ) -> dict[str, Observations]:
        """Return what every camera observes, with Gaussian noise and uniform outliers."""
        found: dict[str, Observations] = {}
        for name, camera, pose in zip(self.rig.names, self.rig.cameras, self.rig.sensor_from_rig, strict=True):
            points, pixels, names = [], [], []
            for k, rig_from_board in enumerate(self.rig_from_board):
                seen, at = visible(camera, pose @ rig_from_board, self.board)
                if len(seen) < MIN_CORNERS:
                    continue
                at = at + rng.normal(0, noise_px, at.shape)
                wrong = rng.random(len(at)) < outliers
                at[wrong] += rng.uniform(-OUTLIER_PX, OUTLIER_PX, (int(wrong.sum()), 2))
                at = np.clip(at, 0, np.array(camera.size) - 1.0)
                points.append(self.board.points[seen])
                pixels.append(at)
                names.append(f"{k:04d}.png")
            extent = [self.board.points[:, :2].min(0), self.board.points[:, :2].max(0)]
            found[name] = Observations.from_arrays(
                points, pixels, size=camera.size, names=names, extent=extent, unit="m"
            )
        return found


def visible(camera: Sensor, cam_from_board: Pose, board: Checkerboard) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a board that a camera sees, and their pixels; none if it faces away."""
    points = cam_from_board @ board.points
    normal, middle = cam_from_board.rotation[:, 2], points.mean(0)
    if normal @ middle < 0.2 * np.linalg.norm(middle):  # z of a board points away from its printed side
        return np.zeros(0, int), np.zeros((0, 2))
    pixels, valid = camera.project(points)
    theta = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
    size = np.array(camera.size)
    inside = (
        valid
        & (theta <= (camera.theta_max or np.pi))
        & (pixels >= MARGIN_PX).all(1)
        & (pixels <= size - 1 - MARGIN_PX).all(1)
    )
    seen = np.flatnonzero(inside)
    return seen, pixels[seen]


def scene(make: Callable[[], Rig], square: float, frames: int, seed: int = 0) -> RigScene:
    """Return a rig with boards that all cameras, and all pairs of neighbours, observe equally often."""
    rng = np.random.default_rng(seed)
    rig, board = make(), Checkerboard(9, 6, square)
    width = float(np.ptp(board.points[:, 0]))
    wanted = _wanted(rig, frames)
    counts = dict.fromkeys(wanted, 0)
    poses: list[Pose] = []
    for _ in range(MAX_ATTEMPTS):
        if all(counts[key] >= count for key, count in wanted.items()):
            break
        pose = _random_pose(rig, board, width, rng)
        seen = [
            k
            for k, (camera, sensor) in enumerate(zip(rig.cameras, rig.sensor_from_rig, strict=True))
            if len(visible(camera, sensor @ pose, board)[0]) >= MIN_CORNERS
        ]
        keys = [(k,) for k in seen] + [(a, b) for a in seen for b in seen if a < b]
        if any(counts.get(key, 0) < wanted.get(key, 0) for key in keys):
            poses.append(pose)
            for key in keys:
                if key in counts:
                    counts[key] += 1
    return RigScene(rig, board, poses)


def _wanted(rig: Rig, frames: int) -> dict[tuple[int, ...], int]:
    """Return how often each camera, and each pair with a common field of view, must observe the board."""
    rng = np.random.default_rng(0)
    bearings = rng.normal(size=(20000, 3))
    seen = rig.in_view(50 * bearings / np.linalg.norm(bearings, axis=1, keepdims=True))
    wanted: dict[tuple[int, ...], int] = {(k,): frames for k in range(len(rig))}
    for a in range(len(rig)):
        for b in range(a + 1, len(rig)):
            if (seen[a] & seen[b]).mean() > 0.005:
                wanted[a, b] = frames // 2
    return wanted


def _random_pose(rig: Rig, board: Checkerboard, width: float, rng: np.random.Generator) -> Pose:
    """Return rig_from_board of a board that faces a random camera of the rig."""
    centres = np.array([pose.inverse().translation for pose in rig.sensor_from_rig])
    camera = int(rng.integers(len(rig)))
    bearing = rng.normal(size=3)
    bearing /= np.linalg.norm(bearing)
    forward = rig.sensor_from_rig[camera].rotation[2]
    if bearing @ forward < -0.2:
        bearing = -bearing
    axis = np.array((0.0, 0.0, 1.0))
    z = bearing  # away from the camera: the printed side faces it
    helper = axis if abs(z @ axis) < 0.9 else np.array((0.0, 1.0, 0.0))
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    facing = np.column_stack([x, np.cross(z, x), z])
    spin, lean = rng.uniform(-np.pi, np.pi), rng.uniform(0, 2 * np.pi)
    tilt = np.radians(rng.uniform(5, 45))
    rotation = facing @ so3.exp(tilt * np.array((np.cos(lean), np.sin(lean), 0))) @ so3.exp(np.array((0, 0, spin)))
    middle = board.points.mean(0)
    return Pose(rotation, centres[camera] + bearing * width * rng.uniform(0.9, 1.8) - rotation @ middle)


def thin_overlap() -> Rig:
    """Return two fisheyes of 185 degrees back to back: 5 degrees of overlap."""
    rig = back_to_back(960)
    camera = _fisheye(960, 960, 185.0)
    return Rig((camera, camera), rig.sensor_from_rig, rig.names)


def stereo() -> Rig:
    """Return a pair of fisheyes of 150 degrees, 11 cm apart."""
    camera = _fisheye(960, 720, 150.0)
    return Rig.from_sensors(
        {"left": (camera, Pose()), "right": (camera, Pose(look(0.5, 0.3), np.array([-0.11, 0.001, 0.002])))}
    )


def chain() -> Rig:
    """Return three fisheyes of 120 degrees, 80 degrees apart: the outer ones have no common view."""
    camera = _fisheye(960, 720, 120.0)
    sensors = {}
    for k, name in enumerate(("left", "middle", "right")):
        rotation = look(-80.0 + 80.0 * k)
        sensors[name] = camera, Pose(rotation, -rotation @ np.array([0.08 * (k - 1), 0.0, 0.0]))
    return Rig.from_sensors(sensors)


def mixed() -> Rig:
    """Return a perspective camera, a fisheye and a mirror camera of different sizes."""
    perspective = Camera(
        RadialTangentialPinhole(fx=620, fy=622, cx=641, cy=358, k1=-0.08, k2=0.02, p1=0.001, p2=-0.0005, k3=0.0),
        (1280, 720),
        theta_max=np.radians(50),
    )
    # With e = 0 the frame of the camera is that of a calibration: e is equivalent to a rotation.
    mirror = replace(model_class("ocam").example(), e=0.0)
    size = (round(2 * mirror.to_dict()["cx"]), round(2 * mirror.to_dict()["cy"]))
    wide = Camera(mirror, size, theta_max=np.radians(95))
    fisheye = _fisheye(960, 720, 170.0)
    turned = look(20.0, -5.0), look(-15.0, 10.0)
    return Rig.from_sensors(
        {
            "perspective": (perspective, Pose()),
            "fisheye": (fisheye, Pose(turned[0], -turned[0] @ np.array([0.1, 0.0, 0.0]))),
            "ocam": (wide, Pose(turned[1], -turned[1] @ np.array([-0.08, 0.05, 0.02]))),
        }
    )


def _fisheye(width: int, height: int, degrees: float) -> Camera:
    rim = np.radians(degrees / 2)
    focal = 0.49 * width / (rim * (1 - 0.01 * rim**2 - 0.001 * rim**4))
    model = KannalaBrandt(
        fx=focal, fy=focal * 1.001, cx=width / 2 + 3.2, cy=height / 2 - 4.1, k1=-0.01, k2=-0.001, k3=0.0, k4=0.0
    )
    return Camera(model, (width, height), theta_max=float(rim))


# Name: rig, side of a square of the board (m), images of each camera.
SCENES: dict[str, tuple[Callable[[], Rig], float, int]] = {
    "back-to-back": (thin_overlap, 0.03, 24),
    "ring": (lambda: ladybug(960), 0.03, 20),
    "car": (lambda: surround_car(1280), 0.25, 20),
    "stereo": (stereo, 0.03, 20),
    "chain": (chain, 0.03, 20),
    "mixed": (mixed, 0.03, 20),
}
