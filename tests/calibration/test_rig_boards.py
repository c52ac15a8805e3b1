"""Rigs that see several boards at once: boards at rest relative to each other, and boards that move."""

import dataclasses

import numpy as np
import pytest
from benchmarks.rig_scenes import visible

import omnisight as om
from calibration.rig_corners import FISHEYE, pose_errors, rig_scene
from omnisight.geometry import rotation as so3

BOARD = om.Checkerboard(9, 6, 0.03)
MIDDLE = BOARD.points.mean(0)
# A margin of three quarters of a square on two sides: the board does not look the same after half a turn.
EXTENT = BOARD.points[:, :2].min(0) - 0.0225, BOARD.points[:, :2].max(0)
MAX_SIGMAS = 3.0


def observe(rig, boards, noise=0.3, seed=0):
    """Return what each camera sees of boards at poses rig_from_board, a list for each board by image."""
    rng, found = np.random.default_rng(seed), {}
    for name, camera, sensor in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True):
        found[name] = {}
        for board, poses in boards.items():
            views = [(k, *visible(camera, sensor @ pose, BOARD)) for k, pose in enumerate(poses)]
            views = [(k, ids, at) for k, ids, at in views if len(ids) >= 12]
            if not views:
                continue
            found[name][board] = om.Observations.from_arrays(
                [BOARD.points[ids] for _, ids, _ in views],
                [at + rng.normal(0, noise, at.shape) for _, _, at in views],
                size=camera.size,
                names=[f"{k:04d}.png" for k, _, _ in views],
                extent=EXTENT,
                unit="m",
            )
    return found


def facing(direction, distance, rng):
    """Return world_from_board of a board in a direction that faces the origin."""
    z = np.array(direction, float) / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(z, x), z]) @ so3.exp(rng.uniform(-0.2, 0.2, 3))
    return om.Pose(rotation, distance * z - rotation @ MIDDLE)


def back_to_back():
    """Return two fisheyes of 120 degrees without a common view."""
    camera = rig_scene("chain", 4).rig.cameras[0]
    back = om.look(180.0, 4.0)
    return om.Rig.from_sensors(
        {"front": (camera, om.Pose()), "back": (camera, om.Pose(back, -back @ np.array([0.04, 0.01, -0.08])))}
    )


def room(rng, count=8):
    """Return world_from_board of boards all around."""
    angles = 2 * np.pi * np.arange(count) / count
    return {f"wall{k}": facing((np.sin(a), 0.1 * (-1) ** k, np.cos(a)), 0.42, rng) for k, a in enumerate(angles)}


def turning(rng, count):
    """Return rig_from_world of a rig that turns in the middle of a room."""
    return [
        om.Pose(so3.exp(rng.uniform(-0.25, 0.25, 3)) @ om.look(rng.uniform(-180, 180)), rng.uniform(-0.06, 0.06, 3))
        for _ in range(count)
    ]


def in_room(rig, count, rng, noise=0.3, seed=0):
    """Return what a rig sees that turns in a room of boards at rest."""
    walls, poses = room(rng), turning(rng, count)
    return observe(rig, {name: [p @ board for p in poses] for name, board in walls.items()}, noise, seed)


def assert_within_uncertainty(calibration, true):
    for name, angle, length in zip(calibration.rig.names[1:], *pose_errors(calibration.rig, true), strict=True):
        assert angle < MAX_SIGMAS * calibration.sigmas(name)[0]
        assert length < MAX_SIGMAS * calibration.sigmas(name)[1]


if __name__ == "__main__":
    rig = back_to_back()
    rng = np.random.default_rng(1)
    obs = in_room(rig, 25, rng)
    import time
    t = time.time()
    c = om.calibrate_rig(obs, FISHEYE)
    print(time.time() - t, c, c.reasons, c.estimate.rigid.sets, [p for p in c.pairs], c.seconds)
    print(pose_errors(c.rig, rig), c.sigmas("back"))
