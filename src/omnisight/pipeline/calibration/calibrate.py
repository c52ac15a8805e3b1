"""Calibration of a camera from images of a board, clips or corners: `omnisight calibrate`."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.board_consistency import leave_out_inconsistent_boards
from omnisight.calibration.candidate import MAX_COMPARED_CORNERS, Candidate
from omnisight.calibration.estimation_options import EstimationOptions
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.model_selection import (
    MIN_VIEWS,
    Selection,
    cross_validate,
    find_inliers,
    fit_candidates,
    select_model,
)
from omnisight.calibration.noncentral import NonCentralSelection, select_axial, select_prescription
from omnisight.calibration.ocamcalib import calibrate_ocamcalib
from omnisight.calibration.redetection import redetect
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.choices import check_options
from omnisight.extensions import did_you_mean_file
from omnisight.formats import load
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel, auto_models, model_class
from omnisight.optics.models.axial import Axial
from omnisight.optics.ray_model import RayModel
from omnisight.pipeline.calibration.calibrate_options import CalibrateOptions
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.pipeline.calibration.interruption import keep_camera
from omnisight.pipeline.calibration.provenance import tool_provenance
from omnisight.pipeline.detection.detect import Source, load_observations
from omnisight.pipeline.detection.detection_advice import ForceRequired, explain_too_few_detections
from omnisight.progress import Progress, no_progress
from omnisight.quality.repeated_views import find_repeated_views, list_pairs
from omnisight.quality.report import assess_central, assess_noncentral
from omnisight.quality.spline_baseline import SplineBaseline, fit_spline_baseline
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

Bools = NDArray[np.bool_]

# Least angle of the corners (radians) above which the centre is the blind spot of a mirror, not a lack of corners.
MIN_BLIND_SPOT_RAD = np.radians(15.0)
# Parameters of a model that one or two views may determine.
MAX_PARAMETERS_OF_FEW_VIEWS = 6


def calibrate(
    source: Source, options: CalibrateOptions = CalibrateOptions(), *, progress: Progress = no_progress
) -> Calibration:
    """Calibrate a camera from images of a board, video clips, corner files or arrays.

    No initial guess of focal length or field of view is needed: lenses and mirrors from 60° to 280° work.

    Parameters
    ----------
    source
        A folder, image files, clips or glob patterns; corner files; lists of arrays; `Detections` or `Observations`.
        See `load_observations`.
    options
        Options of the command.
    progress
        Called with (stage, done, total).

    Raises
    ------
    ValueError
        If an input cannot be read, there are too few images, or no model fits.
    MissingFileError
        If a file or folder does not exist.
    CalibrationInterrupted
        If interrupted (Ctrl-C) after the models were fitted; it has the best camera so far.
    """
    check_options(options, CalibrateOptions)
    started = time.perf_counter()
    design = read_design(options.start)
    observations = drop_images(load_observations(source, options, progress=progress), options.drop)
    check_observations(observations, options, design)
    detected = time.perf_counter()
    observations = leave_out_inconsistent_boards(observations)
    initial = estimate_initial_camera(observations)
    observations, redetection = redetect(observations, initial, apply_exif=options.apply_exif, progress=progress)
    redetected = time.perf_counter()
    initial = resect(initial.central_model, observations)
    subset = observations.at(rows := observations.thinned_rows(MAX_COMPARED_CORNERS))
    candidates = fit_candidates(candidate_models(options, initial, observations), initial, subset, options, progress)
    with keep_camera(lambda: unassessed_camera(candidates, subset)):
        inliers = find_inliers(candidates, subset, observations)
        candidates = cross_validate(candidates, subset, inliers[rows], options, progress)
        selection = refit(
            select_model(candidates, subset, inliers[rows], loss=options.loss), observations, inliers, options
        )
        baseline = fit_spline_baseline(selection.best, initial, observations, inliers, loss=options.loss)
        if options.is_noncentral:
            spline = None if baseline is None else baseline.candidate
            selection = select_noncentral(selection, design, spline, observations, options)
        calibration = assess(selection, observations, inliers, baseline, options)
        if options.method == "ocamcalib":
            calibration = with_ocamcalib(calibration, progress)
    end = time.perf_counter()
    seconds = {"detect": detected - started, "redetect": redetected - detected, "solve": end - redetected}
    return replace(calibration, redetection=redetection, seconds=seconds | {"total": end - started})


def read_design(path: Path | None) -> RayCamera | None:
    """Read the camera of a lens and mirror as designed.

    Raises
    ------
    ValueError
        If the file holds a central camera.
    """
    camera = None if path is None else load(path, option=None)
    if isinstance(camera, Camera):
        raise ValueError(
            f"{path}: a central camera ({camera.model.name}), which needs no initial values: leave out --start. It is"
            " for non-central systems of a lens and a mirror"
        )
    return camera


def drop_images(observations: Observations, names: Sequence[str]) -> Observations:
    """Return the observations without the named images.

    Raises
    ------
    ValueError
        If there is no image of that name, or none remains.
    """
    if not names:
        return observations
    known = observations.image_names or observations.names
    if unknown := [name for name in names if name not in known]:
        some = ", ".join(known[:5]) + (", ..." if len(known) > 5 else "")
        raise ValueError(
            f"--drop: there is no image {', '.join(unknown)}{did_you_mean_file(unknown[0], known)}; there are {some}"
        )
    kept = [i for i, name in enumerate(known) if name not in names]
    if not kept:
        raise ValueError("--drop leaves no image; keep three or more")
    if observations.detections is None:
        return observations.subset(kept)
    detections = observations.detections
    images = [detections.images[i] for i in kept]
    # The hint names another board that most images show.
    is_other = 2 * sum(bool(image.boards) for image in images) < len(images)
    detections = replace(detections, images=images, hint=detections.hint if is_other else None)
    return Observations.from_detections(detections, [known[i] for i in kept])


def check_observations(observations: Observations, options: CalibrateOptions, design: RayCamera | None) -> None:
    """Check that there are enough different views of the right board for a calibration.

    Raises
    ------
    ValueError
        If there are too few views, most images show another board, or the board or the design does not fit the options.
    """
    count, required = len(observations), 1 if options.force else MIN_VIEWS
    if count < required:
        reason = explain_too_few_detections(observations, required)
        raise ForceRequired(reason) if count else ValueError(reason)
    if len(observations.pixels) and min(observations.size) < 1:
        raise ValueError("the image size is unknown: specify --image-size WIDTHxHEIGHT")
    hint = observations.detections.hint if observations.detections else None
    if hint and not options.force:
        raise ForceRequired(hint)
    repeated = find_repeated_views(observations)
    if (distinct := count - len(repeated)) < required:
        raise ForceRequired(
            f"{count} images with a board, of which only {distinct} {'is' if distinct == 1 else 'are'} distinct"
            f" ({list_pairs(repeated)}): at least {MIN_VIEWS} are needed, 10 to 20 are good; move and tilt the board"
            " between images"
        )
    if options.method == "ocamcalib" and not observations.is_planar:
        raise ValueError("--method ocamcalib is for flat boards; these board points do not lie in a plane")
    if design is not None:
        _check_design(design, options.start, observations)


def _check_design(design: RayCamera, path: Path | None, observations: Observations) -> None:
    """Check that a design is for images of this size, in the unit of the board."""
    size, unit = observations.size, observations.unit
    if all(design.size) and design.size != size:
        raise ValueError(f"{path}: for images of {design.width}x{design.height} px; these are {size[0]}x{size[1]} px")
    if design.unit != unit:
        action = "specify the side of a square, such as --square 30mm" if design.unit == "m" else "leave out --square"
        raise ValueError(f"{path}: lengths are in {design.unit}, those of the board in {unit}: {action}")


def candidate_models(options: CalibrateOptions, initial: State, observations: Observations) -> tuple[str, ...]:
    """Return the names of the models to fit: the requested one, or those that suit the angle that corners cover."""
    if not options.is_auto:
        return (options.model,)
    theta = float(angle_from_axis(initial.points(observations)[0]).max())
    names = auto_models(theta)
    if len(observations) >= MIN_VIEWS:
        return names
    # With one or two views only the simplest models are determined.
    free = {name: sum(p.free for p in model_class(name).example().parameters) for name in names}
    return tuple(name for name in names if free[name] <= MAX_PARAMETERS_OF_FEW_VIEWS)


def refit(selection: Selection, observations: Observations, inliers: Bools, options: EstimationOptions) -> Selection:
    """Fit the selected model to all observations; models may have been compared on a subset of the corners."""
    compared = selection.best
    best = compared.refit(observations, inliers, loss=options.loss)
    reason = selection.reason
    if best.corners > compared.corners and len(selection.candidates) > 1:
        reason += f" (models compared on {compared.corners} of {best.corners} corners)"
    first = best if best.corners == compared.corners else compared
    return Selection(best, (first, *selection.candidates[1:]), reason)


def select_noncentral(
    central: Selection,
    design: RayCamera | None,
    spline: Candidate | None,
    observations: Observations,
    options: EstimationOptions,
) -> NonCentralSelection:
    """Fit and select non-central models, starting from the central ones or from a design."""
    weights = ResidualWeights.estimate(central.best.state, observations)
    inliers = ~weights.outliers(central.best.state, observations)
    if design is not None:
        return select_prescription(design.model, central, observations, inliers, options)
    is_complete = spline is not None and len(spline.state.rotations) == len(observations)
    return select_axial(central, spline if is_complete else None, observations, inliers, options.loss)


def assess(
    selection: Selection,
    observations: Observations,
    inliers: Bools,
    baseline: SplineBaseline | None,
    options: CalibrateOptions,
) -> Calibration:
    """Return the calibrated camera with its uncertainty, quality checks, verdict and provenance."""
    state = selection.best.state
    outliers = ResidualWeights.estimate(state, observations, options.loss).outliers(state, observations)
    if isinstance(selection, NonCentralSelection):
        camera, quality = assess_noncentral(
            selection.best,
            selection.central,
            _ray_camera(state, observations, outliers),
            observations,
            outliers,
            inliers,
            baseline=baseline,
            loss=options.loss,
        )
    else:
        camera, quality = assess_central(
            selection.best,
            selection.candidates,
            _central_camera(state, observations, outliers),
            observations,
            outliers,
            baseline,
            loss=options.loss,
            is_auto=options.is_auto,
        )
    calibration = Calibration(camera, observations, selection, outliers, quality)
    camera = replace(camera, calibration=calibration.figures(), provenance=provenance(observations))
    return replace(calibration, camera=camera)


def unassessed_camera(candidates: Sequence[Candidate], observations: Observations) -> Camera:
    """Return the camera of the candidate with the lowest rms; its accuracy is unknown."""
    best = min(candidates, key=lambda candidate: candidate.rms)
    outliers = ResidualWeights.estimate(best.state, observations).outliers(best.state, observations)
    reason = "Interrupted before the accuracy was assessed. Calibrate again."
    figures = {"verdict": "do not use", "reasons": [reason], "rms": best.rms}
    camera = _central_camera(best.state, observations, outliers)
    return replace(camera, calibration=figures, provenance=provenance(observations))


def _central_camera(state: State, observations: Observations, outliers: Bools) -> Camera:
    """Return the camera of a central state with its calibrated cone."""
    assert isinstance(state.model, CameraModel)
    in_domain = np.isfinite(state.residuals(observations)).all(1)
    angles = angle_from_axis(state.points(observations)[0])[~outliers & in_domain]
    least = float(angles.min(initial=np.pi))
    return Camera(
        state.model,
        observations.size,
        theta_max=float(angles.max(initial=0.0)),
        theta_min=least if least > MIN_BLIND_SPOT_RAD else 0.0,
    )


def _ray_camera(state: State, observations: Observations, outliers: Bools) -> RayCamera:
    """Return the camera of a non-central state with its calibrated cone."""
    assert isinstance(state.model, RayModel)
    angles = angle_from_axis(state.model.rays(observations.pixels[~outliers])[1])
    least = float(np.nanmin(angles))
    has_blind_spot = not isinstance(state.model, Axial) or least > MIN_BLIND_SPOT_RAD
    return RayCamera(
        state.model,
        observations.size,
        unit=observations.unit,
        theta_max=float(np.nanmax(angles)),
        theta_min=least if has_blind_spot else 0.0,
    )


def with_ocamcalib(calibration: Calibration, progress: Progress) -> Calibration:
    """Return the calibration with the camera of Scaramuzza's original method, and the errors of both.

    The verdict is that of omnisight's camera, so it is among its figures.
    """
    observations, camera = calibration.observations, calibration.camera
    assert isinstance(camera, Camera)
    result = calibrate_ocamcalib(observations, observations.size, progress=progress)
    own = ("rms", "mean", "outliers", "verdict", "reasons")
    figures = {
        **{name: camera.calibration[name] for name in ("images", "corners")},
        "method": "ocamcalib",
        **result.errors()["refined"],
        "omnisight": {"model": camera.model.name, **{name: camera.calibration[name] for name in own}},
    }
    camera = replace(camera, model=result.model, covariance=None, calibration=figures)
    return replace(calibration, camera=camera, ocamcalib=result)


def provenance(observations: Observations) -> dict[str, Any]:
    """Return what a camera file stores about its origin."""
    detections = observations.detections
    if detections is None or detections.board is None:
        return {**tool_provenance(), "images": list(observations.names)}
    return {
        **tool_provenance(),
        "pattern": str(detections.board),
        "target": detections.board.to_dict(),
        "images": [image.path.name for image in detections.found],
        "images_given": len(detections.images),
    }
