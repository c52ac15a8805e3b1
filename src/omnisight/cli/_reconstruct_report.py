"""Report of `omnisight reconstruct`."""

import math
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import numpy as np

from omnisight.cli._output import write_json
from omnisight.display import rounded
from omnisight.pipeline.reconstruction.reconstruction_result import ExtrinsicsChange, ReconstructionResult
from omnisight.reconstructions import remove_reconstruction
from omnisight.rig import Rig
from omnisight.sfm.georeference import MAX_SCALE_SIGMA, Georeference
from omnisight.sfm.reconstruction import Reconstruction

# Mean number of images per point below which wrong matches can agree with wrong poses.
WEAK_TRACK_LENGTH = 2.25


def model_folder(output: Path, number: int) -> Path:
    """Return the folder of a model; the first is the largest."""
    return output if number == 0 else output / str(number)


def remove_models(output: Path, first: int) -> None:
    """Delete the models of an earlier run from a number on."""
    while (folder := model_folder(output, first)).is_dir():
        remove_reconstruction(folder)
        first += 1


def print_json(result: ReconstructionResult) -> None:
    """Print the result as one JSON object."""
    write_json(summary(result))


def summary(result: ReconstructionResult) -> dict[str, object]:
    """Return the figures of a reconstruction for JSON."""
    model = result.models[0] if result else None
    has_points = model is not None and len(model.points) > 0
    return {
        "registered": len(model) if model else 0,
        "images": result.images,
        "models": [len(each) for each in result.models],
        "model_of_image": {name: k for k, each in enumerate(result.models) for name in each.names},
        "points": len(model.points) if model else 0,
        "observations": len(model.observations) if model else 0,
        "rms_px": model.rms_px if model and has_points else None,
        "mean_track_length": model.mean_track_length if model and has_points else None,
        "has_scale": bool(model and model.has_scale),
        "scale_sigma": model.scale_sigma if model and model.has_scale and np.isfinite(model.scale_sigma) else None,
        "georeference": _georeference_json(result),
        "self_calibrated": list(result.self_calibrated),
        "focal_length_changes": focal_length_changes_json(result),
        "extrinsics_changes": _extrinsics_changes_json(result),
        "unregistered": result.unregistered,
        "unverified": list(model.unverified) if model else [],
        "seconds": round(result.seconds, 3),
        "peak_memory_mb": _megabytes(result),
        "reason": result.reason,
    }


def _georeference_json(result: ReconstructionResult) -> dict[str, object] | None:
    """Return how the largest model was brought into metres."""
    if not result.georeferences:
        return None
    georeference = result.georeferences[0]
    return {
        "images": georeference.images,
        "inliers": georeference.inliers,
        "sigma_m": None if georeference.sigma is None else georeference.sigma.tolist(),
        "origin": result.models[0].origin,
        "reason": georeference.reason,
    }


def _megabytes(result: ReconstructionResult) -> int | None:
    """Return the peak memory of a reconstruction, MB."""
    return None if result.peak_memory_bytes is None else round(result.peak_memory_bytes / 1e6)


def print_report(result: ReconstructionResult, output: Path) -> None:
    """Print the models, their viewer, and the images that are in none of them."""
    if result.simultaneous:
        same = {"name": "name apart from the camera's"}.get(result.simultaneous, result.simultaneous)
        print(f"rig         images of different cameras with the same {same} were taken together")
    for number, model in enumerate(result.models):
        print(f"model       {len(model)} of {result.images} images, written to {model_folder(output, number)}/")
        if not len(model.points):
            print("points      none: these images were taken in one place, only their orientations are known")
            continue
        track = f"{len(model.observations)} observations, {model.mean_track_length:.1f} images per point"
        print(f"points      {len(model.points)}, {track}")
        print(f"residuals   {model.rms_px:.3f} px (rms)")
        for warning in weaknesses(model):
            print(f"warning     {warning}")
        for name in result.self_calibrated:
            print(_describe_camera(model.rig, name))
        if len(model.rig_from_world) > 1:
            sigma, which = model.rotation_sigma_deg, " of the verified poses" if model.unverified else ""
            figure = "unknown, no pose is verified" if np.isnan(sigma) else f"± {sigma:.4f}° (1σ, median{which})"
            print(f"rotation    {figure}")
        if model.has_scale:
            print(f"scale       {_describe_scale(model)}")
        elif len(model) > 1:
            print("scale       arbitrary")
        if result.georeferences:
            _print_georeference(result.georeferences[number], model)
    for change in result.extrinsics_changes:
        print(f"rig         {_describe_change(change, result.models[0].rig.unit)}")
    for warning in focal_length_warnings(result):
        print(f"warning     {warning}")
    memory = "" if (megabytes := _megabytes(result)) is None else f", {megabytes} MB of memory at most"
    print(f"time        {result.seconds:.0f} s{memory}")
    print(f"look at     {(output / 'viewer.html').resolve().as_uri()}")
    for reason, count in Counter(result.unregistered.values()).items():
        first = next(name for name, why in result.unregistered.items() if why == reason)
        others = f" and {count - 1} more" if count > 1 else ""
        print(f"left out    {first}{others}: {reason.removeprefix(f'{first}: ')}")


def focal_length_changes_json(result: ReconstructionResult) -> dict[str, object]:
    """Return the suspicious focal lengths of cameras by their names."""
    return {name: asdict(change) for name, change in result.focal_length_changes.items()}


def focal_length_warnings(result: ReconstructionResult) -> list[str]:
    """Return which cameras have a suspicious focal length, and what to do."""
    return [
        f"{name}: the images agree best with {change.description}: does the camera file belong to these images, and"
        " were they resized or cropped?"
        for name, change in result.focal_length_changes.items()
    ]


def weaknesses(model: Reconstruction) -> list[str]:
    """Return what makes the poses of a model uncertain, and what to do."""
    found: list[str] = []
    if model.mean_track_length < WEAK_TRACK_LENGTH:
        found.append(
            "most points are in two images only, so that nothing verifies poses, estimated cameras and their standard"
            " deviations: take images closer together, and of more texture; a wrong calibration has the same effect"
        )
    if model.unverified:
        names = ", ".join(model.unverified[:5]) + (" ..." if len(model.unverified) > 5 else "")
        number = f"{len(model.unverified)} {'pose is' if len(model.unverified) == 1 else 'poses are'}"
        found.append(f"{number} not verified by points in three or more images: {names}; take more images there")
    if model.scale_sigma > MAX_SCALE_SIGMA and model.has_scale:
        found.append(
            "the scale is uncertain: the cameras of the rig are close to each other for the distance of the points;"
            " take images closer to them"
        )
    return found


def _describe_scale(model: Reconstruction) -> str:
    """Return how well the metre of a model is known."""
    sigma = model.scale_sigma
    if sigma >= 1:
        return "unknown: the cameras of the rig are too close to each other for the distance of the points"
    of = ", median of the distances of points" if len(model.rig_from_world) == 1 else ""
    return f"metres, ± {sigma:.2%} (1σ{of})" if np.isfinite(sigma) else "metres"


def _print_georeference(georeference: Georeference, model: Reconstruction) -> None:
    """Print how many known positions a model agrees with, and the origin of its world."""
    if not georeference:
        print(f"warning     not in metres: {georeference.reason}")
    if georeference and georeference.sigma is not None:
        scatter = ", ".join(rounded(sigma, 3) for sigma in georeference.sigma)
        agreeing = f"{georeference.inliers} of {georeference.images}"
        print(f"positions   {agreeing} agree within {scatter} m (1σ; x, y, z)")
    if model.origin is not None:
        latitude, longitude, altitude = model.origin
        print(f"origin      {latitude:.7f}, {longitude:.7f}, {altitude:.1f} m (WGS 84; x east, y north, z up)")


def _extrinsics_changes_json(result: ReconstructionResult) -> list[dict[str, object]]:
    """Return how far the refined poses of the cameras on the rig are from those of its file."""
    in_metres = bool(result) and result.models[0].rig.unit == "m"
    return [
        {
            "camera": change.camera,
            "distance_m": change.distance if in_metres else None,
            "sigma_m": _finite(change.distance_sigma) if in_metres else None,
            "angle_deg": math.degrees(change.angle),
            "sigma_deg": _finite(math.degrees(change.angle_sigma)),
        }
        for change in result.extrinsics_changes
    ]


def _finite(value: float) -> float | None:
    """Return a number for JSON; None if it is not known."""
    return value if math.isfinite(value) else None


def _describe_change(change: ExtrinsicsChange, unit: str) -> str:
    """Return how far a camera was moved on its rig."""
    moved = f"{change.distance:.4g} ± {rounded(change.distance_sigma, 2)} {unit}"
    if unit == "m":
        moved = f"{1e3 * change.distance:.2f} ± {1e3 * change.distance_sigma:.2f} mm"
    angle, sigma = math.degrees(change.angle), math.degrees(change.angle_sigma)
    return f"{change.camera}: {moved} and {angle:.3f} ± {sigma:.3f}° from its pose in the file (1σ)"


def _describe_camera(rig: Rig, name: str) -> str:
    """Return focal length and distortion of a camera that was estimated from the images, and a warning."""
    camera = rig.cameras[rig.index(name)]
    sigma = np.full(len(camera.model.params), np.nan)
    if camera.covariance is not None:
        sigma = np.sqrt(np.diag(camera.covariance))
    focal, k1 = (camera.model.param_names.index(each) for each in ("fx", "k1"))
    values = [f"{camera.model.params[i]:.{digits}f} ± {rounded(sigma[i], 1)}" for i, digits in ((focal, 2), (k1, 5))]
    return (
        f"warning     {name}: has no calibration; estimated from the images: {camera.model.name}, f = {values[0]} px,"
        f" k1 = {values[1]}. Calibrate it with a board (omnisight calibrate) for accurate results"
    )
