"""Calibration of a rig from simultaneous images of a board: `omnisight calibrate-rig`."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from omnisight.calibration.rigs.cross_validation import held_out_lengths
from omnisight.calibration.rigs.estimation import RigEstimate, Unconnected, estimate_rig
from omnisight.calibration.rigs.frame_uncertainty import with_frame_covariances
from omnisight.calibration.rigs.initial_rig import is_reliable
from omnisight.calibration.rigs.observations import RigObservations, RigPart
from omnisight.calibration.rigs.relative_poses import half_turn
from omnisight.calibration.rigs.rig_free_parameters import RigFreeParameters
from omnisight.pipeline.calibrate_rig_options import CalibrateRigOptions
from omnisight.pipeline.options import check_options
from omnisight.pipeline.provenance import tool_provenance
from omnisight.pipeline.rig_calibration import RigCalibration, pair_evidence
from omnisight.pipeline.rig_cameras import RigCamera, check_not_exchanged, rig_camera
from omnisight.pipeline.rig_sources import RigSources, named_sources, with_common_frames
from omnisight.pipeline.simultaneous_views import SimultaneousViews, read_times, simultaneous_views
from omnisight.rig import Rig
from omnisight.targets.observations import Observations

Progress = Callable[[str, int, int], None]

# Distance, relative to the step of the board, below which two points are the same.
SAME_POINT_SHARE = 0.01


def calibrate_rig(
    sources: RigSources | Sequence[str | PathLike[str]],
    options: CalibrateRigOptions = CalibrateRigOptions(),
    *,
    progress: Progress | None = None,
) -> RigCalibration:
    """Calibrate a rig: the cameras, their poses relative to each other, the board poses and the board warp, jointly.

    Parameters
    ----------
    sources
        What `calibrate` takes for each camera, by name; or one folder, clip or pattern for each, which names it.
        Simultaneous images have the same name, number, place in the order, or time.
    options
        Options of the command.
    progress
        Called with (stage, done, total).

    Raises
    ------
    ValueError
        If an input cannot be read, a camera sees too few boards, or common boards do not connect the cameras.
    """
    check_options(options, CalibrateRigOptions)
    report, started = progress or (lambda stage, done, total: None), time.perf_counter()
    named = with_common_frames(_with_reference_first(named_sources(sources), options), options, report)
    _check_names(named, options)
    cameras = [rig_camera(name, source, options, report) for name, source in named.items()]
    check_not_exchanged(cameras)
    alone = time.perf_counter()
    observations, simultaneous = rig_observations(cameras, options)
    report("refine rig", 0, 1)
    try:
        estimate = estimate_rig(
            observations,
            [camera.state for camera in cameras],
            free_parameters(cameras, options),
            is_symmetric=all(_is_symmetric(camera.observations) for camera in cameras),
        )
    except Unconnected as error:
        raise ValueError(explain_unconnected(error, observations, simultaneous)) from error
    report("refine rig", 1, 1)
    calibration = assess(cameras, estimate, simultaneous, list(named_sources(sources)))
    end = time.perf_counter()
    seconds = {"cameras": alone - started, "rig": end - alone, "total": end - started}
    return replace(calibration, seconds=seconds)


def _with_reference_first(named: dict[str, Any], options: CalibrateRigOptions) -> dict[str, Any]:
    """Return the sources with the reference camera first."""
    reference = options.reference
    if reference is None:
        return named
    if reference not in named:
        raise ValueError(f"--reference {reference}: there is no such camera; there are {', '.join(named)}")
    return {reference: named[reference], **named}


def _check_names(named: Mapping[str, Any], options: CalibrateRigOptions) -> None:
    """Check that every known camera has images."""
    if unknown := [name for name in options.camera_files if name not in named]:
        raise ValueError(f"--camera {unknown[0]}: there are no images of this camera; there are {', '.join(named)}")


def rig_observations(
    cameras: Sequence[RigCamera], options: CalibrateRigOptions
) -> tuple[RigObservations, SimultaneousViews]:
    """Return the views of all cameras in groups of simultaneous ones.

    Raises
    ------
    ValueError
        If boards are in different units, or no rule finds simultaneous images.
    """
    units = {camera.observations.unit for camera in cameras}
    if len(units) > 1:
        raise ValueError("the size of the board is known for some of the cameras only: specify --square or --target")
    times = None if options.times is None else read_times(options.times)
    simultaneous = simultaneous_views({camera.name: camera.observations for camera in cameras}, times)
    parts = tuple(
        RigPart(index, 0, camera.observations, group, delays)
        for index, (camera, group, delays) in enumerate(
            zip(cameras, simultaneous.groups, simultaneous.delays, strict=True)
        )
    )
    names = tuple(camera.name for camera in cameras)
    return RigObservations(names, parts, simultaneous.names, simultaneous.seconds), simultaneous


def free_parameters(cameras: Sequence[RigCamera], options: CalibrateRigOptions) -> RigFreeParameters:
    """Return what the joint refinement estimates: what calibrating each camera alone did, and one board warp."""
    warp = not options.flat and any(camera.warp for camera in cameras)
    timed = options.times is not None
    return RigFreeParameters(tuple(camera.directions for camera in cameras), (warp,), time_offsets=timed)


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


def assess(
    cameras: Sequence[RigCamera], estimate: RigEstimate, simultaneous: SimultaneousViews, order: Sequence[str]
) -> RigCalibration:
    """Return the calibrated rig with its uncertainty, checks, verdict and provenance; cameras in the given order."""
    names, state = estimate.observations.names, estimate.state
    calibrated = tuple(
        replace(
            camera.camera, model=model, covariance=covariance if camera.directions.size else camera.camera.covariance
        )
        for camera, model, covariance in zip(cameras, state.models, estimate.covariance.cameras, strict=True)
    )
    offsets = tuple(state.time_offsets.tolist()) if estimate.has_time_offsets else ()
    poses = tuple(state.sensor_from_rig.one(k) for k in range(len(names)))
    unit = cameras[0].observations.unit
    rig = Rig(calibrated, poses, names, time_offsets=offsets, unit=unit)
    frames = [camera.frame_covariance for camera in cameras]
    rig = replace(rig, covariance=with_frame_covariances(estimate.covariance.extrinsics, rig, frames))
    held_out = held_out_lengths(estimate.problem, state)
    rule = simultaneous.rule
    result = RigCalibration(rig.subset(order), tuple(cameras), estimate, held_out, rule, pair_evidence(estimate))
    provenance = {**tool_provenance(), "images": {c.name: list(c.observations.names) for c in cameras}}
    return replace(result, rig=replace(result.rig, calibration=result.figures(), provenance=provenance))


def explain_unconnected(error: Unconnected, observations: RigObservations, simultaneous: SimultaneousViews) -> str:
    """Return why common boards do not connect the cameras, with the pairs and what to do."""
    names, seen = observations.names, observations.seen()
    counts = [
        f"{names[a]}-{names[b]} {int((seen[a] & seen[b]).sum())}"
        + (
            ""
            if (pair := error.pairs.get((a, b))) is None or is_reliable(pair)
            else f" ({pair.support} agree on a relative pose)"
        )
        for a in range(len(names))
        for b in range(a + 1, len(names))
    ]
    contradicting = [pair for pair in error.pairs.values() if not is_reliable(pair)]
    advice = (
        "the images are not simultaneous, or the cameras moved: check that images with the same"
        f" {'place in the order' if simultaneous.rule == 'order' else simultaneous.rule} were taken at the same time"
        if contradicting
        else "take about 10 images with the board where two of the cameras that are not connected both see it"
    )
    parts = " | ".join(", ".join(part) for part in error.components)
    return (
        f"the cameras are not connected ({parts}): simultaneous images of a board by pair of cameras, matched by"
        f" {simultaneous.rule}: {', '.join(counts)}; {advice}"
    )
