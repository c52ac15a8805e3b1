"""The views of all cameras of a rig by board and time, and what the joint refinement estimates."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from omnisight.calibration.rigs.observations import AGREES, RigObservations, RigPart
from omnisight.calibration.rigs.rig_free_parameters import RigFreeParameters
from omnisight.calibration.rigs.sightings import half_turn
from omnisight.calibration.state import State
from omnisight.pipeline.rig_calibration.calibrate_rig_options import CalibrateRigOptions
from omnisight.pipeline.rig_calibration.rig_cameras import RigCamera
from omnisight.pipeline.rig_calibration.simultaneous_views import (
    SimultaneousViews,
    image_names,
    read_times,
    simultaneous_views,
)
from omnisight.targets.observations import Observations

# Distance, relative to the step of the board, below which two points are the same.
SAME_POINT_SHARE = 0.01


def rig_observations(
    cameras: Sequence[RigCamera], options: CalibrateRigOptions
) -> tuple[RigObservations, list[State], SimultaneousViews]:
    """Return the views of all cameras, one group for each board and time, with the states of the cameras alone.

    Raises
    ------
    ValueError
        If boards are in different units, or no rule finds simultaneous images.
    """
    units = {views.unit for camera in cameras for views in camera.boards.values()}
    if len(units) > 1:
        raise ValueError("the size of the board is known for some of the cameras only: specify --square or --target")
    times = None if options.times is None else read_times(options.times)
    images = {
        camera.name: list(dict.fromkeys(name for views in camera.boards.values() for name in image_names(views)))
        for camera in cameras
    }
    simultaneous = simultaneous_views(images, times)
    boards = list(dict.fromkeys(board for camera in cameras for board in camera.boards))
    frames, parts, states = len(simultaneous.names), list[RigPart](), list[State]()
    for index, camera in enumerate(cameras):
        for board, views in camera.boards.items():
            frame, delays = simultaneous.of_views(index, views.names)
            number = boards.index(board)
            parts.append(RigPart(index, number, views, number * frames + frame, delays))
            states.append(camera.states[board])
    count, seconds = len(boards), simultaneous.seconds
    observations = RigObservations(
        tuple(camera.name for camera in cameras),
        tuple(parts),
        simultaneous.names * count,
        np.tile(np.arange(frames), count),
        tuple(boards),
        np.full(count * frames, AGREES),
        None if seconds is None else np.tile(seconds, count),
    )
    return observations, states, simultaneous


def free_parameters(
    cameras: Sequence[RigCamera], observations: RigObservations, options: CalibrateRigOptions
) -> RigFreeParameters:
    """Return what the joint refinement estimates: what calibrating each camera alone did, and a warp of each board."""
    warp = not options.flat and any(camera.warp for camera in cameras)
    timed = observations.seconds is not None
    directions = tuple(camera.directions for camera in cameras)
    return RigFreeParameters(directions, (warp,) * len(observations.boards), time_offsets=timed)


def symmetric_boards(observations: RigObservations) -> tuple[bool, ...]:
    """Return for each board whether it looks the same after half a turn."""
    return tuple(
        all(_is_symmetric(part.observations) for part in observations.parts if part.board == board)
        for board in range(len(observations.boards))
    )


def _is_symmetric(observations: Observations) -> bool:
    """Return whether the board looks the same after half a turn; of arrays, whether its points do."""
    board = None if observations.detections is None else observations.detections.board
    if board is not None:
        return bool(getattr(board, "is_symmetric", False))
    points = observations.points
    turned = half_turn(observations) @ points
    first = points[observations.groups[0]]
    step = np.linalg.norm(first[1:] - first[:-1], axis=1).min(initial=np.inf)
    distance, _ = KDTree(points).query(turned)
    return bool((distance < SAME_POINT_SHARE * step).mean() > 0.5)
