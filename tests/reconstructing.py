"""A small synthetic reconstruction: an equirectangular camera, a fisheye and a rig of two fisheyes."""

import dataclasses

import numpy as np

from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.images import write_image
from omnisight.models import model_class
from omnisight.rig import Rig
from omnisight.sfm.reconstruction import PointObservations, Points, Reconstruction
from omnisight.views import fisheye, perspective, sphere

NOISE_PX = 0.3


def fisheye_camera(theta_max_deg=95.0, size=480):
    """Return a Kannala-Brandt fisheye whose image circle ends at an angle from the axis."""
    ideal = fisheye(size, 2 * theta_max_deg)
    f = 0.95 * ideal.model.fx  # the circle lies in the image
    model = model_class("kannala_brandt")(f, f, ideal.model.cx, ideal.model.cy, 0.01, -0.002, 0.0003, 0.0)
    return Camera(model, ideal.size, theta_max=np.radians(theta_max_deg))


CAMERAS = {
    "equidistant": lambda: fisheye(480, 190.0),
    "equirectangular": lambda: sphere(640),
    "fisheye": fisheye_camera,
    "narrow_fisheye": lambda: fisheye_camera(80.0),
    "pinhole": lambda: perspective((640, 480), 80.0),
}


def single(name="equirectangular", frames=6, seed=0):
    """Return a reconstruction by one camera that moves on a circle."""
    return reconstruct(Rig((CAMERAS[name](),), (Pose(),), ("camera",)), frames, seed)


def two_fisheyes(camera="fisheye", frames=4, seed=1):
    """Return a reconstruction by two fisheyes that look to opposite sides; the rig frame is that of neither."""
    poses = (
        Pose(so3.exp([0.0, 0.2, 0.0]), np.array([0.02, 0.01, 0.03])),
        Pose(so3.exp([0.0, np.pi - 0.1, 0.0]), np.array([-0.04, 0.0, 0.05])),
    )
    return reconstruct(Rig((CAMERAS[camera](), CAMERAS[camera]()), poses, ("front", "back")), frames, seed)


def independent(names=("equirectangular", "pinhole"), frames=6, seed=2):
    """Return a reconstruction by several cameras, each image a frame of its own."""
    rig = Rig(tuple(CAMERAS[name]() for name in names), (Pose(),) * len(names), tuple(names))
    return reconstruct(rig, frames, seed, sensors=[k % len(names) for k in range(frames)])


def without_points(made):
    """Return the reconstruction with the poses alone."""
    none = {field.name: getattr(made.points, field.name)[:0] for field in dataclasses.fields(made.points)}
    unseen = made.observations.select(np.arange(0))
    return dataclasses.replace(made, points=type(made.points)(**none), observations=unseen)


def reconstruct(rig, frames, seed, sensors=None):
    """Return points in a room, their projections with noise, and poses on a circle."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-1, 1, (60, 3))
    position *= 4 / np.abs(position).max(axis=1, keepdims=True)
    angles = np.linspace(0, 2 * np.pi, frames, endpoint=False)
    poses = tuple(
        Pose(so3.exp([0.1 * np.sin(a), a + 0.3, 0.05])) @ Pose(translation=-np.array([np.cos(a), 0.1, np.sin(a)]))
        for a in angles
    )
    images = [(s, f) for f in range(frames) for s in (range(len(rig)) if sensors is None else [sensors[f]])]
    names = tuple(f"{rig.names[s]}/{f:03d}.png" for s, f in images)
    columns = [[], [], [], []]
    for i, (s, f) in enumerate(images):
        exact, valid = rig.cameras[s].project((rig.sensor_from_rig[s] @ poses[f]) @ position)
        valid &= rig.cameras[s].in_image(exact)
        if rig.cameras[s].theta_max is not None:
            valid &= rig.cameras[s].calibrated((rig.sensor_from_rig[s] @ poses[f]) @ position)
        seen = np.flatnonzero(valid)
        noise = rng.normal(0, NOISE_PX, (len(seen), 2))
        for column, values in zip(columns, (np.full(len(seen), i), seen, exact[seen] + noise, -noise), strict=True):
            column.append(values)
    image, point, pixels, residuals = map(np.concatenate, columns)
    covariance = np.zeros((frames, 6, 6))
    covariance[1:] = np.diag(np.arange(1.0, 7.0) * 1e-6)
    return Reconstruction(
        rig=rig,
        names=names,
        sensor=np.array([s for s, _ in images]),
        frame=np.array([f for _, f in images]),
        rig_from_world=poses,
        pose_covariance=covariance,
        points=Points(
            position, np.tile(np.eye(3) * 1e-4, (len(position), 1, 1)), rng.integers(0, 256, (60, 3), np.uint8)
        ),
        observations=PointObservations(image, point, pixels, residuals),
        has_scale=len(rig) > 1,
    )


def paint(made, folder, radius_px=6):
    """Write images of the points: bright squares of their colours on dark gray."""
    for i, name in enumerate(made.names):
        camera = made.rig.cameras[made.sensor[i]]
        image = np.full((camera.height, camera.width, 3), 40, np.uint8)
        pixels, valid = camera.project(made.cam_from_world(i) @ made.points.position)
        valid &= camera.in_image(pixels)
        for (u, v), color in zip(pixels[valid], made.points.color[valid], strict=True):
            u, v = round(u), round(v)
            image[max(v - radius_px, 0) : v + radius_px + 1, max(u - radius_px, 0) : u + radius_px + 1] = (
                color // 2 + 128
            )
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_image(folder / name, image)
    return folder
