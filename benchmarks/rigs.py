"""Calibration of rendered rigs with exact truth, beside OpenCV.

`python -m benchmarks rigs [SCENE ...]` prints one row per rig and method: the largest errors of rotation and
translation over the cameras of the rig, relative to the standard deviation that omnisight states, and the time from
corners to result. Corners have 0.3 px of Gaussian noise, and 5 % of them are up to 30 px off; OpenCV, whose loss is not
robust, is also given corners without outliers. OpenCV calibrates pairs, from the corners that both cameras observe,
each camera alone first. The row "cameras known" starts from cameras that omnisight calibrated alone and refines all
parameters jointly; the other rows of omnisight also contain model selection, cross-validation and the tests of each
camera, which OpenCV does not make. Times are CPU times. `--monte-carlo N` repeats omnisight with N noises and prints
the ratio of the true to the stated error.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from typing import Any

import cv2 as opencv
import numpy as np

import omnisight as om
from benchmarks.rig_scenes import SCENES, RigScene, scene
from omnisight.geometry import rotation as so3

cv2: Any = opencv  # the stubs lack omnidir and the flags of fisheye
CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-9)
# Corners that a pair of views must have in common.
MIN_COMMON = 12
SCENE_SEED, NOISE_SEED = 0, 1
OUTLIER_SHARE = 0.05
# Rigs of pairs with common corners whose cameras OpenCV has a model for; those of the others see corners beyond 90
# degrees off-axis, or are mixed.
PAIRS = {"stereo": ("left", "right"), "chain": ("left", "middle")}


@dataclass(frozen=True)
class Row:
    """The result of one method on one rig.

    Attributes
    ----------
    scene, method
        Names.
    rotation_deg, translation_mm
        Largest errors over the cameras; None if the method failed.
    sigmas
        Largest error relative to the stated standard deviation; None without one.
    seconds
        CPU time from corners to result, s.
    note
        Why it failed.
    """

    scene: str
    method: str
    rotation_deg: float | None
    translation_mm: float | None
    sigmas: float | None
    seconds: float
    note: str = ""


def main(arguments: Sequence[str]) -> None:
    """Print the table, or the Monte Carlo test."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks rigs", description=__doc__)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--monte-carlo", type=int, metavar="N", default=0)
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.scenes if name not in SCENES]:
        parser.error(f"{unknown[0]}: no such scene; there are {', '.join(SCENES)}")
    names = options.scenes or list(SCENES)
    _warm_up()
    if options.monte_carlo:
        print("rig             rotation   translation   (true error / stated sigma, rms)")
        for name in names:
            rotation, translation = monte_carlo(name, options.monte_carlo)
            print(f"{name:<15} {rotation:8.2f}   {translation:11.2f}", flush=True)
        return
    print("rig             method                      rotation deg  translation mm  sigmas  seconds")
    for name in names:
        for row in rows(name):
            figures = f"{row.note}"
            if row.rotation_deg is not None and row.translation_mm is not None:
                sigmas = "" if row.sigmas is None else f"{row.sigmas:.1f}"
                figures = f"{row.rotation_deg:12.4f}  {row.translation_mm:14.3f}  {sigmas:>6}  {row.seconds:7.2f}"
            print(f"{row.scene:<15} {row.method:<27} {figures}", flush=True)


def rows(name: str) -> Iterator[Row]:
    """Yield the results of all methods on one rig."""
    true = _scene(name)
    observations = true.observe(np.random.default_rng(NOISE_SEED), outliers=OUTLIER_SHARE)
    for label, given in (("omnisight", None), ("omnisight, kannala_brandt", "kannala_brandt")):
        if given is None or name != "mixed":
            yield ours(name, label, true, observations, given or "auto")
    if name not in PAIRS:
        return
    clean = true.observe(np.random.default_rng(NOISE_SEED), outliers=0.0)
    pair = PAIRS[name]
    two = RigScene(true.rig.subset(pair), true.board, true.rig_from_board)
    both = {c: clean[c] for c in pair}
    yield ours(name, "omnisight, pair, no outliers", two, both, "kannala_brandt")
    yield with_known_cameras(name, two, both)
    for label, corners in (("", observations), (", no outliers", clean)):
        yield _guarded(name, f"cv2.fisheye{label}", two, lambda c=corners: cv2_fisheye(c, pair))
        if hasattr(cv2, "omnidir"):
            yield _guarded(name, f"cv2.omnidir{label}", two, lambda c=corners: cv2_omnidir(c, pair))
        yield _guarded(name, f"cv2.stereoCalibrate{label}", two, lambda c=corners: cv2_pinhole(c, pair))


def ours(name: str, label: str, true: RigScene, observations: Mapping[str, om.Observations], model: str) -> Row:
    """Return the result of omnisight."""
    start = time.process_time()
    calibration = om.calibrate_rig(observations, om.CalibrateRigOptions(model=model))
    seconds = time.process_time() - start
    angles, lengths, ratios = errors(true, calibration)
    return Row(name, label, np.degrees(max(angles)), 1e3 * max(lengths), max(ratios), seconds)


def with_known_cameras(name: str, true: RigScene, observations: Mapping[str, om.Observations]) -> Row:
    """Return the result of omnisight that starts from calibrated cameras and refines them jointly."""
    calibration = om.calibrate_rig(observations, om.CalibrateRigOptions(model="kannala_brandt"))
    with TemporaryDirectory() as folder:
        files = [f"{camera.name}={folder}/{camera.name}.json" for camera in calibration.cameras]
        for camera, entry in zip(calibration.cameras, files, strict=True):
            om.save(camera.camera, entry.partition("=")[2])
        start = time.process_time()
        refined = om.calibrate_rig(observations, om.CalibrateRigOptions(camera=tuple(files), refine_cameras=True))
        seconds = time.process_time() - start
    angles, lengths, ratios = errors(true, refined)
    label = "omnisight, cameras known"
    return Row(name, label, np.degrees(max(angles)), 1e3 * max(lengths), max(ratios), seconds)


def errors(true: RigScene, calibration: om.RigCalibration) -> tuple[list[float], list[float], list[float]]:
    """Return the rotation and translation error of each camera but the first, and the larger one in sigmas."""
    rig, first = calibration.rig, true.rig.sensor_from_rig[true.rig.index(calibration.rig.names[0])]
    angles, lengths, ratios = list[float](), list[float](), list[float]()
    for name, pose in list(zip(rig.names, rig.sensor_from_rig, strict=True))[1:]:
        exact = true.rig.sensor_from_rig[true.rig.index(name)] @ first.inverse()
        angle = float(np.linalg.norm(so3.log(pose.rotation @ exact.rotation.T)))
        length = float(np.linalg.norm(pose.translation - exact.translation))
        sigmas = calibration.sigmas(name)
        angles.append(angle)
        lengths.append(length)
        ratios.append(max(angle / sigmas[0], length / sigmas[1]))
    return angles, lengths, ratios


def monte_carlo(name: str, count: int) -> tuple[float, float]:
    """Return the rms error relative to the rms stated standard deviation, of rotations and translations."""
    true, squares = _scene(name), list[np.ndarray]()
    for seed in range(count):
        observations = true.observe(np.random.default_rng(seed), outliers=OUTLIER_SHARE)
        model = "auto" if name == "mixed" else "kannala_brandt"
        calibration = om.calibrate_rig(observations, om.CalibrateRigOptions(model=model))
        angles, lengths, _ = errors(true, calibration)
        stated = np.array([calibration.sigmas(camera) for camera in calibration.rig.names[1:]])
        squares.append(np.stack([np.column_stack([angles, lengths]) ** 2, stated**2]))
    error, sigma = np.concatenate(squares, axis=1).mean(axis=1)
    ratio = np.sqrt(error / sigma)
    return float(ratio[0]), float(ratio[1])


def common_corners(
    observations: Mapping[str, om.Observations], pair: tuple[str, str]
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Return board points and the pixels of both cameras, of each image that both observe, for OpenCV."""
    left, right = (observations[name] for name in pair)
    points, first, second = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
    for k, image in enumerate(left.names):
        if image not in right.names:
            continue
        a, b = left.groups[k], right.groups[right.names.index(image)]
        ids = {tuple(point): i for i, point in enumerate(right.points[b].round(9).tolist())}
        matched = [(i, ids[tuple(p)]) for i, p in enumerate(left.points[a].round(9).tolist()) if tuple(p) in ids]
        if len(matched) >= MIN_COMMON:
            i, j = np.array(matched).T
            points.append(left.points[a][i])
            first.append(left.pixels[a][i])
            second.append(right.pixels[b][j])
    return points, first, second


def equal_corners(
    observations: Mapping[str, om.Observations], pair: tuple[str, str]
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Return the common corners with the same number in each image, which cv2.fisheye and cv2.omnidir need.

    It is the number for which most corners remain; they are distributed over the board.
    """
    common = common_corners(observations, pair)
    lengths = sorted(map(len, common[0]), reverse=True)
    count = max(lengths, key=lambda n: n * sum(length >= n for length in lengths), default=MIN_COMMON)
    rows = [np.linspace(0, len(view) - 1, count).round().astype(int) for view in common[0]]
    points, first, second = (
        [view[r] for view, r in zip(views, rows, strict=True) if len(view) >= count] for views in common
    )
    return points, first, second


def cv2_fisheye(observations: Mapping[str, om.Observations], pair: tuple[str, str]) -> om.Pose:
    """Return right_from_left by cv2.fisheye."""
    points, left, right = equal_corners(observations, pair)
    x, a, b = ([v.reshape(1, -1, v.shape[1]) for v in values] for values in (points, left, right))
    size = observations[pair[0]].size
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    single = [cv2.fisheye.calibrate(x, c, size, None, None, flags=flags, criteria=CRITERIA)[1:3] for c in (a, b)]
    (k1, d1), (k2, d2) = single
    flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    found = cv2.fisheye.stereoCalibrate(x, a, b, k1, d1, k2, d2, size, flags=flags, criteria=CRITERIA)
    return om.Pose(np.array(found[5], float), np.ravel(np.array(found[6], float)))


def cv2_omnidir(observations: Mapping[str, om.Observations], pair: tuple[str, str]) -> om.Pose:
    """Return right_from_left by cv2.omnidir."""
    points, left, right = equal_corners(observations, pair)
    x, a, b = ([v.reshape(1, -1, v.shape[1]) for v in values] for values in (points, left, right))
    sizes = [observations[name].size for name in pair]
    empty = [None] * 6
    found = cv2.omnidir.stereoCalibrate(x, a, b, *sizes, *empty, 0, CRITERIA)
    rotation = cv2.Rodrigues(np.asarray(found[10], float))[0]
    return om.Pose(np.array(rotation, float), np.ravel(np.array(found[11], float)))


def cv2_pinhole(observations: Mapping[str, om.Observations], pair: tuple[str, str]) -> om.Pose:
    """Return right_from_left by cv2.stereoCalibrate."""
    points, left, right = ([v.astype(np.float32) for v in values] for values in common_corners(observations, pair))
    size, flags = observations[pair[0]].size, cv2.CALIB_RATIONAL_MODEL
    single = [cv2.calibrateCamera(points, c, size, None, None, flags=flags)[1:3] for c in (left, right)]
    (k1, d1), (k2, d2) = single
    flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    found = cv2.stereoCalibrate(points, left, right, k1, d1, k2, d2, size, flags=flags, criteria=CRITERIA)
    return om.Pose(np.array(found[5], float), np.ravel(np.array(found[6], float)))


def _guarded(name: str, method: str, true: RigScene, run: Callable[[], om.Pose]) -> Row:
    """Return the result of a method that may fail."""
    start = time.process_time()
    try:
        pose = run()
    except (cv2.error, ValueError, IndexError) as error:
        return Row(name, method, None, None, None, time.process_time() - start, f"fails: {str(error).strip()[:70]}")
    seconds = time.process_time() - start
    exact = true.rig.sensor_from_rig[1] @ true.rig.sensor_from_rig[0].inverse()
    angle = float(np.degrees(np.linalg.norm(so3.log(pose.rotation @ exact.rotation.T))))
    return Row(name, method, angle, 1e3 * float(np.linalg.norm(pose.translation - exact.translation)), None, seconds)


def _scene(name: str) -> RigScene:
    make, square, frames = SCENES[name]
    return scene(make, square, frames, SCENE_SEED)


def _warm_up() -> None:
    """Compile, so that no time contains it."""
    om.calibrate_rig(
        _scene("stereo").observe(np.random.default_rng(NOISE_SEED)), om.CalibrateRigOptions(model="kannala_brandt")
    )
