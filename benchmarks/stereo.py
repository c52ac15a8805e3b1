"""Distances of rendered stereo pairs against the depth of the renderer.

`python -m benchmarks stereo` prints the table of docs/guide/stereo.md. The rendered images are kept in the cache
folder, or in the folder of temporary files if it does not exist.
"""

import argparse
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.features_pairs import Shot, cameras, free_region, shoot_at

Array = NDArray[np.float64]

PAIRS = (("fisheye", "fisheye"), ("mirror", "mirror"), ("sphere", "sphere"), ("fisheye", "mirror"))
BASELINES = (0.1, 0.2, 0.3)
# Places along the diagonal of the free region of a scene.
PLACES = (0.2, 0.5, 0.8)
# Rotation of the right camera: no rig is exactly parallel.
TURN_DEG = (1.0, -2.0, 1.5)
LARGE_ERROR = 0.05
# Quotient of the standard deviation and the median of the absolute value of a normal variable.
SIGMA_OF_MEDIAN = 1.4826


@dataclass(frozen=True)
class Score:
    """Result of a pair.

    Attributes
    ----------
    error
        (N,) errors relative to the distance, with their sign.
    normalized
        (N,) errors over their standard deviations.
    share
        Share of the pixels of the left image, without the sky, that have a distance.
    sky
        Share of the pixels of the sky that have one; NaN without sky.
    row_px
        Median row difference.
    seconds
        Time.
    """

    error: Array
    normalized: Array
    share: float
    sky: float
    row_px: float
    seconds: float


def shoot_pair(scene: str, names: tuple[str, str], baseline: float, place: float) -> tuple[Shot, Shot]:
    """Render a pair with a baseline along the x axis of the left camera, or read it from the cache."""
    left, right = (cameras()[name] for name in names)
    low, high = free_region(scene)
    world_from_left = om.Pose(left.world_from_cam.rotation, low + place * (high - low))
    centre = world_from_left @ np.array([baseline, 0.0, 0.0])
    turn = om.look(*TURN_DEG).T
    return shoot_at(scene, left, world_from_left), shoot_at(
        scene, right, om.Pose(right.world_from_cam.rotation @ turn, centre)
    )


def evaluate(left: Shot, right: Shot) -> Score:
    """Compare the distances of a pair with the depth of the left image."""
    sensors = {"left": (left.camera, om.Pose()), "right": (right.camera, right.pose.inverse() @ left.pose)}
    result = om.stereo(left.image, right.image, om.Rig.from_sensors(sensors))
    depth, seen = left.renderer.truth().depth, result.rectification.masks[0]
    solid = seen & np.isfinite(depth)
    known = solid & np.isfinite(result.distance)
    error = result.distance[known] - depth[known]
    sky = seen & ~np.isfinite(depth)
    return Score(
        error / depth[known],
        error / result.sigma[known],
        float(known.sum() / solid.sum()),
        float(np.isfinite(result.distance[sky]).mean()) if sky.any() else float("nan"),
        result.check.row_px,
        result.seconds,
    )


def row(name: str, scores: list[Score]) -> str:
    """Return a row of the table: quantiles over all pixels, means over pairs."""
    error = np.concatenate([s.error for s in scores])
    normalized = SIGMA_OF_MEDIAN * np.median(np.abs(np.concatenate([s.normalized for s in scores])))
    sky = np.array([s.sky for s in scores])
    cells = (
        name,
        f"{100 * np.median(np.abs(error)):.2f}",
        f"{100 * np.mean(np.abs(error) > LARGE_ERROR):.1f}",
        f"{100 * np.mean([s.share for s in scores]):.0f}",
        f"{100 * np.mean(sky[np.isfinite(sky)]):.1f}" if np.isfinite(sky).any() else "-",
        f"{normalized:.2f}",
        f"{np.mean([s.row_px for s in scores]):.2f}",
        f"{np.median([s.seconds for s in scores]):.1f}",
    )
    return "| " + " | ".join(cells) + " |"


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks stereo", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one place, and baselines of 0.1 and 0.3 m")
    quick = parser.parse_args(arguments).quick
    places, baselines = (PLACES[1:2], BASELINES[::2]) if quick else (PLACES, BASELINES)
    heading = "error % | above 5 % | share % | sky % | error/sigma | rows px | s |"
    print(f"| scene, cameras, baseline | {heading}\n" + "|---" * 8 + "|")
    for scene in ("room", "street"):
        for names in PAIRS:
            for baseline in baselines:
                scores = [evaluate(*shoot_pair(scene, names, baseline, place)) for place in places]
                pair = names[0] if names[0] == names[1] else " and ".join(names)
                print(row(f"{scene}, {pair}, {baseline:g} m", scores), flush=True)


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
