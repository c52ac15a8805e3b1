"""Calibration of a rig from simultaneous images of a board: `omnisight calibrate-rig`."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.model_selection import CLAIM_SIGNIFICANCE
from omnisight.calibration.rigs.cross_validation import held_out_lengths
from omnisight.calibration.rigs.estimation import RigEstimate, Unconnected, estimate_rig
from omnisight.calibration.rigs.model_uncertainty import model_covariance, model_error
from omnisight.camera import Camera
from omnisight.choices import check_options
from omnisight.extensions import did_you_mean_file
from omnisight.pipeline.calibration.provenance import tool_provenance
from omnisight.pipeline.detection.detect import image_names
from omnisight.pipeline.rig_calibration.calibrate_rig_options import CalibrateRigOptions
from omnisight.pipeline.rig_calibration.rig_calibration import RigCalibration, pair_evidence
from omnisight.pipeline.rig_calibration.rig_cameras import (
    RigCamera,
    check_different_images,
    check_not_exchanged,
    check_not_mirrored,
    rig_camera,
)
from omnisight.pipeline.rig_calibration.rig_observations import free_parameters, rig_observations, symmetric_boards
from omnisight.pipeline.rig_calibration.rig_sources import RigSources, named_sources, with_common_frames
from omnisight.pipeline.rig_calibration.simultaneous_views import SimultaneousViews, read_times
from omnisight.pipeline.rig_calibration.unconnected_rig import explain_unconnected
from omnisight.progress import Progress, no_progress
from omnisight.rig import Rig

Array = NDArray[np.float64]


def calibrate_rig(
    sources: RigSources | Sequence[str | PathLike[str]],
    options: CalibrateRigOptions = CalibrateRigOptions(),
    *,
    progress: Progress = no_progress,
) -> RigCalibration:
    """Calibrate a rig: the cameras, their poses relative to each other, the board poses and board warps, jointly.

    Parameters
    ----------
    sources
        What `calibrate` takes for each camera, by name; or one folder, clip or pattern for each, which names it. The
        observations of several boards by a camera may be given by the name of the board.
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
    started = time.perf_counter()
    named = with_common_frames(_with_reference_first(named_sources(sources), options), options, progress)
    _check_names(named, options)
    cameras = [rig_camera(name, source, options, progress) for name, source in named.items()]
    check_different_images(cameras)
    check_not_mirrored(cameras)
    check_not_exchanged(cameras)
    alone = time.perf_counter()
    observations, states, simultaneous = rig_observations(cameras, options)
    progress("refine rig", 0, 1)
    free = free_parameters(cameras, observations, options)
    try:
        estimate = estimate_rig(observations, states, free, symmetric=symmetric_boards(observations))
    except Unconnected as error:
        raise ValueError(explain_unconnected(error, simultaneous.rule)) from error
    progress("refine rig", 1, 1)
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
    """Check that every known camera has images, that the times can be read, and that the images to drop exist."""
    if unknown := [name for name in options.camera_files if name not in named]:
        raise ValueError(f"--camera {unknown[0]}: there are no images of this camera; there are {', '.join(named)}")
    if options.times is not None:
        read_times(options.times)  # before the boards are detected
    if not options.drop:
        return
    single = options.single(next(iter(options.targets.values())))
    views = [v for source in named.values() for v in (source.values() if isinstance(source, Mapping) else [source])]
    images = {image for each in views for image in image_names(each, single)}
    if unknown := [name for name in options.drop if name not in images]:
        raise ValueError(f"--drop: no camera has an image {unknown[0]}{did_you_mean_file(unknown[0], images)}")


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
    unit = estimate.observations.parts[0].observations.unit
    rig = Rig(calibrated, poses, names, time_offsets=offsets, unit=unit)
    candidates = [() if camera.calibration is None else camera.calibration.candidates for camera in cameras]
    covariance = estimate.covariance.extrinsics + model_covariance(estimate.problem, state, candidates)
    change = _model_error(cameras, estimate)
    if change is not None:
        covariance += np.outer(change, change)
    rig = replace(rig, covariance=covariance)
    held_out = held_out_lengths(estimate.problem, state)
    rule, pairs = simultaneous.rule, pair_evidence(estimate)
    result = RigCalibration(rig.subset(order), tuple(cameras), estimate, held_out, rule, pairs, change)
    provenance = {**tool_provenance(), "images": {c.name: c.images for c in cameras}}
    return replace(result, rig=replace(result.rig, calibration=result.figures(), provenance=provenance))


def _model_error(cameras: Sequence[RigCamera], estimate: RigEstimate) -> Array | None:
    """Return the effect of the errors of the camera models on the extrinsics; None without a sign of such errors."""
    baselines = {
        k: baseline
        for k, camera in enumerate(cameras)
        if camera.calibration is not None
        and isinstance(camera.camera, Camera)
        and (baseline := camera.calibration.quality.spline_baseline) is not None
        and baseline.is_reliable
    }
    is_too_simple = any(b.is_significant and b.p_value < CLAIM_SIGNIFICANCE for b in baselines.values())
    if not baselines or not (is_too_simple or estimate.problem.motion is not None):
        return None
    splines = {k: baseline.candidate for k, baseline in baselines.items()}
    return model_error(estimate.problem, estimate.state, estimate.together, splines)
