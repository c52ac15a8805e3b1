"""Observations of simulated rigs, and changes of them."""

from dataclasses import replace

import numpy as np
from benchmarks.rig_scenes import SCENES, RigScene, scene

import omnisight as om
from omnisight.geometry import rotation as so3

FISHEYE = om.CalibrateRigOptions(model="kannala_brandt", flat=True)


def rig_scene(name, frames=None):
    """Return one of the simulated rigs."""
    make, square, default = SCENES[name]
    return scene(make, square, frames or default)


def selected(observations, views):
    """Return views of several observations, given as (observations, view)."""
    first = observations
    return om.Observations.from_arrays(
        [o.points[o.groups[v]] for o, v in views],
        [o.pixels[o.groups[v]] for o, v in views],
        size=first.size,
        names=[o.names[v] for o, v in views],
        extent=first.extent,
        unit=first.unit,
    )


def with_moved_camera(true, observations, name, first, step):
    """Return the observations of a rig one of whose cameras moved by a step before the frame `first`."""
    k = true.rig.index(name)
    poses = list(true.rig.sensor_from_rig)
    poses[k] = poses[k].moved(step)
    after = RigScene(replace(true.rig, sensor_from_rig=tuple(poses)), true.board, true.rig_from_board)
    late, early = after.observe(np.random.default_rng(9))[name], observations[name]
    views = [(early, v) for v, image in enumerate(early.names) if int(image[:4]) < first]
    views += [(late, v) for v, image in enumerate(late.names) if int(image[:4]) >= first]
    return {**observations, name: selected(early, views)}


def renamed(observations, shift):
    """Return observations whose images have the numbers of others."""
    return replace(observations, names=tuple(f"{int(name[:4]) + shift:04d}.png" for name in observations.names))


def pose_errors(rig, true):
    """Return the angle (radians) and the length by which each camera but the first of a rig is off."""
    first = true.sensor_from_rig[true.index(rig.names[0])].inverse()
    exact = [true.sensor_from_rig[true.index(name)] @ first for name in rig.names[1:]]
    pairs = list(zip(rig.sensor_from_rig[1:], exact, strict=True))
    assert pairs
    angles = [float(np.linalg.norm(so3.log(p.rotation @ e.rotation.T))) for p, e in pairs]
    return angles, [float(np.linalg.norm(p.translation - e.translation)) for p, e in pairs]
