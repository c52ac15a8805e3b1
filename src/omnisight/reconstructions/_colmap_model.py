"""A reconstruction in COLMAP's terms, which its text and its binary files have in common.

Numbers start at 1. The centre of the top-left pixel is (0.5, 0.5), and the frame of a rig is that of its first camera.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from omnisight.camera import Camera
from omnisight.formats._readers import WHOLE_SPHERE_DEG
from omnisight.formats._values import HALF_PIXEL
from omnisight.formats.colmap import READERS, colmap_camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import quaternions
from omnisight.geometry.sphere import angle_from_axis
from omnisight.sfm.reconstruction import Reconstruction

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
ADVICE = "export it with --to splat, which writes perspective views"


@dataclass(frozen=True)
class ColmapCamera:
    """A line of cameras.txt: the name of the model and its parameters."""

    model: str
    size: tuple[int, int]
    params: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """Two lines of images.txt.

    Attributes
    ----------
    name
        The name of the image.
    camera
        The number of the camera.
    pose
        Quaternion w x y z and translation of cam_from_world.
    pixels
        (N, 2).
    points
        (N,) numbers of the points.
    """

    name: str
    camera: int
    pose: tuple[float, ...]
    pixels: Array
    points: Indices


@dataclass(frozen=True)
class ColmapRig:
    """A line of rigs.txt: the number of the reference camera, and sensor_from_rig of the others by their numbers."""

    reference: int
    sensors: dict[int, tuple[float, ...]]


@dataclass(frozen=True)
class ColmapFrame:
    """A line of frames.txt: the number of the rig, rig_from_world, and the numbers of camera and image."""

    rig: int
    pose: tuple[float, ...]
    images: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class ColmapModel:
    """The tables of a COLMAP model; an item has the number of its place, from 1.

    Attributes
    ----------
    cameras, rigs, frames, images
        The items.
    position, color, error
        (P, 3), (P, 3) and (P,), the mean reprojection error in px; 0 for a point without observations.
    tracks
        For each point (L, 2) the numbers of the images and the places of the pixels in them, from 0.
    """

    cameras: tuple[ColmapCamera, ...]
    rigs: tuple[ColmapRig, ...]
    frames: tuple[ColmapFrame, ...]
    images: tuple[ColmapImage, ...]
    position: Array
    color: NDArray[np.uint8]
    error: Array
    tracks: list[NDArray[np.int64]]


def colmap_model(reconstruction: Reconstruction) -> ColmapModel:
    """Return a reconstruction in COLMAP's terms.

    Cameras that share a frame are one rig; independent cameras are rigs of their own.

    Raises
    ------
    ValueError
        If COLMAP has no model of a camera, or its model ends before the observations.
    """
    cameras = tuple(_camera(reconstruction, sensor) for sensor in range(len(reconstruction.rig)))
    rig_of_sensor, references = _rigs(reconstruction)
    poses, frames = reconstruction.rig.sensor_from_rig, list[ColmapFrame]()
    for frame in np.unique(reconstruction.frame):
        members = np.flatnonzero(reconstruction.frame == frame)
        rig = rig_of_sensor[reconstruction.sensor[members[0]]]
        pose = poses[references[rig]] @ reconstruction.rig_from_world[frame]
        pairs = tuple((int(reconstruction.sensor[image]) + 1, int(image) + 1) for image in members)
        frames.append(ColmapFrame(int(rig) + 1, _numbers(pose), pairs))
    rigs: list[ColmapRig] = []
    for rig, reference in enumerate(references):
        others = [int(sensor) for sensor in np.flatnonzero(rig_of_sensor == rig) if sensor != reference]
        rig_from_reference = poses[reference].inverse()
        rigs.append(ColmapRig(reference + 1, {s + 1: _numbers(poses[s] @ rig_from_reference) for s in others}))
    return _with_points(reconstruction, cameras, tuple(rigs), tuple(frames))


def _with_points(
    reconstruction: Reconstruction,
    cameras: tuple[ColmapCamera, ...],
    rigs: tuple[ColmapRig, ...],
    frames: tuple[ColmapFrame, ...],
) -> ColmapModel:
    """Return the model with the images, their pixels and the points."""
    observations, points = reconstruction.observations, reconstruction.points
    by_image = np.argsort(observations.image, kind="stable")
    ends = np.cumsum(np.bincount(observations.image, minlength=len(reconstruction)))
    place = np.empty(len(observations), np.int64)
    images: list[ColmapImage] = []
    for image, chosen in enumerate(np.split(by_image, ends[:-1])):
        place[chosen] = np.arange(len(chosen))
        pose = _numbers(reconstruction.cam_from_world(image))
        pixels = observations.pixels[chosen] + HALF_PIXEL
        camera = int(reconstruction.sensor[image]) + 1
        images.append(ColmapImage(reconstruction.names[image], camera, pose, pixels, observations.point[chosen] + 1))
    count = np.bincount(observations.point, minlength=len(points))
    lengths = np.linalg.norm(observations.residuals, axis=1)
    error = np.bincount(observations.point, lengths, minlength=len(points)) / np.maximum(count, 1)
    by_point = np.argsort(observations.point, kind="stable")
    tracks = np.column_stack([observations.image[by_point] + 1, place[by_point]])
    split = np.split(tracks, np.cumsum(count)[:-1]) if len(points) else []
    return ColmapModel(cameras, rigs, frames, tuple(images), points.position, points.color, error, split)


def _camera(reconstruction: Reconstruction, sensor: int) -> ColmapCamera:
    """Return a camera; raise ValueError with the remedy if COLMAP cannot represent it."""
    camera, name = reconstruction.rig.cameras[sensor], reconstruction.rig.names[sensor]
    if not isinstance(camera, Camera):
        raise ValueError(
            f"camera {name} is non-central ({camera.model.name}), and those of COLMAP are central: {ADVICE}"
        )
    try:
        exported, model, params = colmap_camera(camera)
    except ValueError as error:
        raise ValueError(f"camera {name}: COLMAP {error}; or {ADVICE}") from error
    limit, reach = READERS[camera.model.name].theta_max_deg, np.degrees(_reach(reconstruction, sensor, camera))
    if limit < WHOLE_SPHERE_DEG and reach >= limit:
        raise ValueError(
            f"camera {name} ({camera.model.name}) sees up to {reach:.0f} degrees from its axis, and this model ends at"
            f" {limit:g} degrees in COLMAP: {ADVICE}"
        )
    return ColmapCamera(model, exported.size, tuple(params))


def _reach(reconstruction: Reconstruction, sensor: int, camera: Camera) -> float:
    """Return the angle from the axis (radians) to which a camera is calibrated or has observations."""
    observations = reconstruction.observations
    pixels = observations.pixels[reconstruction.sensor[observations.image] == sensor]
    angles = angle_from_axis(camera.unproject(pixels)[0])
    return float(np.nanmax(angles, initial=camera.theta_max or 0.0))


def _rigs(reconstruction: Reconstruction) -> tuple[Indices, list[int]]:
    """Return the rig of each sensor (S,), and the first sensor of each rig."""
    pairs = reconstruction.sensor, reconstruction.frame + len(reconstruction.rig)
    nodes = len(reconstruction.rig) + len(reconstruction.rig_from_world)
    graph = coo_array((np.ones(len(reconstruction)), pairs), shape=(nodes, nodes))
    labels = np.asarray(connected_components(graph, directed=False)[1][: len(reconstruction.rig)], np.intp)
    _, first, rig_of_sensor = np.unique(labels, return_index=True, return_inverse=True)
    return rig_of_sensor, [int(sensor) for sensor in first]


def _numbers(pose: Pose) -> tuple[float, ...]:
    """Return the quaternion w x y z and the translation of a pose."""
    x, y, z, w = quaternions(pose.rotation).tolist()
    return w, x, y, z, *pose.translation.tolist()
