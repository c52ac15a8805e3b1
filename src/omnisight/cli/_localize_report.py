"""Output of `omnisight map` and `omnisight localize`."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.cli._console import console
from omnisight.cli._output import warn, write_json
from omnisight.cli._reconstruct_report import focal_length_changes_json, focal_length_warnings, weaknesses
from omnisight.display import rounded
from omnisight.geometry.rotation import quaternions
from omnisight.images import unreadable_warnings
from omnisight.localization.localize import LocalizedImage
from omnisight.localization.visual_map import VisualMap
from omnisight.pipeline.localization.localization_result import LocalizationResult
from omnisight.pipeline.reconstruction.reconstruction_result import ReconstructionResult


def print_map_json(made: VisualMap | None, result: ReconstructionResult) -> None:
    """Print a map as one JSON object."""
    images, degrees = made.longest_track if made else (0, 0.0)
    data = {
        "images": result.images,
        "registered": len(made.reconstruction) if made else 0,
        "points": len(made.reconstruction.points) if made else 0,
        "descriptors": len(made.descriptors) if made else 0,
        "has_scale": bool(made and made.reconstruction.has_scale),
        "longest_track_images": images,
        "longest_track_deg": degrees,
        "unregistered": missing_images(result),
        "unverified": made.reconstruction.unverified if made else [],
        "focal_length_changes": focal_length_changes_json(result),
        "seconds": round(result.seconds, 3),
        "reason": result.reason,
    }
    write_json(data)


def missing_images(result: ReconstructionResult) -> dict[str, str]:
    """Return the images that a map lacks, with the reason: it holds the largest model only."""
    others = {name: "not connected with the map" for model in result.models[1:] for name in model.names}
    return others | result.unregistered


def print_map(made: VisualMap, result: ReconstructionResult, output: Path) -> None:
    """Print the size of a map, and the images that it lacks."""
    model, (images, degrees) = made.reconstruction, made.longest_track
    print(f"map       {len(model)} of {result.images} images, {len(model.points)} points in {_unit(made)}")
    print(f"tracks    longest in {images} images, widest over {degrees:.0f}° of the view")
    if not len(model.points):
        print("warning   without points no image can be localized: take images from different places")
    for warning in [*weaknesses(model), *focal_length_warnings(result)]:
        print(f"warning   {warning}")
    for name, reason in missing_images(result).items():
        print(f"missing   {name}: {reason}")
    print(f"time      {result.seconds:.1f} s")
    print(f"written   {output}")


def print_json(found: LocalizationResult, known: VisualMap) -> None:
    """Print the poses as one JSON object."""
    images = [{"name": name, **_as_dict(image)} for name, image in found.items()]
    data = {
        "localized": sum(map(bool, found.values())),
        "images": images,
        "has_scale": known.reconstruction.has_scale,
        "focal_length_change": found.focal_length_change and asdict(found.focal_length_change),
    }
    write_json(data)


def print_warnings(found: LocalizationResult) -> None:
    """Print warnings on stderr."""
    unreadable = {name: image.reason for name, image in found.items() if not image.is_usable}
    for warning in unreadable_warnings(unreadable, len(found)):
        warn(warning)
    if (change := found.focal_length_change) and change.is_suspicious:
        warn(
            f"the images agree best with {change.description}: does the camera file belong to these images, and"
            " were they resized or cropped? Otherwise calibrate the camera (omnisight calibrate), or that of the map"
        )


def _as_dict(image: LocalizedImage) -> dict[str, Any]:
    """Return a pose and its figures."""
    figures: dict[str, Any] = {"matches": image.matches, "inliers": image.inliers, "nearest": image.nearest or None}
    if image.cam_from_world is None:
        return {"localized": False, "reason": image.reason, **figures}
    world_from_cam, (angle, distance) = image.cam_from_world.inverse(), image.sigmas
    is_known = bool(np.isfinite(image.covariance).all())
    return {
        "localized": True,
        "position": world_from_cam.translation.tolist(),
        "rotation_xyzw": quaternions(world_from_cam.rotation).tolist(),
        "sigma_deg": float(np.degrees(angle)) if is_known else None,
        "sigma_position": distance if is_known else None,
        "covariance": image.covariance.tolist() if is_known else None,
        **figures,
    }


def print_report(found: LocalizationResult, known: VisualMap, output: Path | None) -> None:
    """Print a table of the poses."""
    from rich.table import Table

    out, unit = console(), "m" if known.reconstruction.has_scale else ""
    table = Table(
        "image", f"position {unit}".strip(), f"± {unit}".strip(), "± deg", "inliers", "", box=None, pad_edge=False
    )
    for column in table.columns[1:5]:
        column.justify = "right"
    for name, image in found.items():
        if image.cam_from_world is None:
            table.add_row(name, "", "", "", f"{image.inliers}/{image.matches}", image.reason)
            continue
        angle, distance = image.sigmas
        position = " ".join(f"{value:.3f}" for value in image.cam_from_world.inverse().translation + 0.0)
        sigmas = [rounded(value) if np.isfinite(value) else "unknown" for value in (distance, np.degrees(angle))]
        table.add_row(name, position, *sigmas, f"{image.inliers}/{image.matches}", f"near {image.nearest}")
    out.print(table)
    out.print()
    if change := found.focal_length_change:
        print(f"camera    the images agree best with {change.description};")
        print("          the standard deviations include its effect")
    print(f"localized {sum(map(bool, found.values()))} of {len(found)} images in {_unit(known)}")
    print(f"written   {output or 'nothing'}")


def _unit(known: VisualMap) -> str:
    """Return the unit of a map."""
    return "metres" if known.reconstruction.has_scale else "an arbitrary unit"
