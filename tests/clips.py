"""A rendered video of a board in front of a fisheye camera, for the tests of videos."""

import struct
from functools import cache

import cv2
import numpy as np

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.simulation import BoardInScene, fisheye_setup
from omnisight.targets import Checkerboard

BOARD = Checkerboard(9, 6, 0.04)
SETUP = fisheye_setup(480)
POSE_COUNT, FRAMES_AT_REST, FRAMES_IN_MOTION, EMPTY_FRAMES = 8, 8, 5, 12
# Exposure time over frame interval while the board moves.
EXPOSURE = 0.1


@cache
def rendered_clip():
    """Return frames (H, W, 3) RGB, and for each frame its pose index, "moving" or "empty"."""
    renderer, rng, centre = SETUP.renderer(samples=1), np.random.default_rng(3), BOARD.points.mean(0)
    poses = [board.cam_from_board for board in SETUP.boards(POSE_COUNT, BOARD)]

    def render(pose):
        return renderer([BoardInScene(BOARD, pose)], noise=0).image.astype(np.float32)

    def interpolate(a, b, t):
        rotation = a.rotation @ so3.exp(t * so3.log(a.rotation.T @ b.rotation))
        return Pose(rotation, (1 - t) * (a @ centre) + t * (b @ centre) - rotation @ centre)

    empty = renderer(noise=0).image.astype(np.float32)
    clean, labels = [], []
    for i, (pose, next_pose) in enumerate(zip(poses, [*poses[1:], poses[0]], strict=True)):
        clean += [render(pose)] * FRAMES_AT_REST
        labels += [i] * FRAMES_AT_REST
        for k in range(FRAMES_IN_MOTION):
            times = (k + 0.5 + np.array((0.0, EXPOSURE))) / FRAMES_IN_MOTION
            clean.append(np.mean([render(interpolate(pose, next_pose, t)) for t in times], axis=0))
            labels.append("moving")
        if i == POSE_COUNT // 2:
            clean += [empty] * EMPTY_FRAMES
            labels += ["empty"] * EMPTY_FRAMES
    noise = 1.5 * rng.standard_normal(empty.shape, np.float32)
    noisy = [frame + np.roll(noise, rng.integers(99, size=2), (0, 1)) for frame in clean]
    return [np.clip(np.rint(frame), 0, 255).astype(np.uint8) for frame in noisy], labels


def write_clip(path, frames, codec="MJPG", frame_rate=24):
    """Write frames (H, W, 3) RGB as a video file."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), frame_rate, frames[0].shape[1::-1])
    assert writer.isOpened()
    writer.set(cv2.VIDEOWRITER_PROP_QUALITY, 95)
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    return path


def with_rotation(path):
    """Set a rotation by 90 degrees in the track header of an MP4 file."""
    data = bytearray(path.read_bytes())
    matrix = data.index(b"tkhd") + 44
    one = 1 << 16
    data[matrix : matrix + 36] = struct.pack(">9i", 0, one, 0, -one, 0, 0, 0, 0, 1 << 30)
    path.write_bytes(data)
    return path
