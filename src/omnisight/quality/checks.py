"""What can be wrong with a calibration: each check finds one thing, and says what to do."""

import numpy as np

from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.quality.coverage import SECTORS, SIDES
from omnisight.quality.evidence import Check, Evidence, Level
from omnisight.quality.identifiability import focal_relative_sigma, unidentifiable_parameters
from omnisight.quality.rolling_shutter import rolling_shutter
from omnisight.targets.observations import Observations

# Where nothing else is said a limit is measured: `python -m benchmarks verdict` calibrates cameras that are known, and
# docs/guide/calibrate.md has its table. Lengths are in px of an image 1000 px wide; a larger one may be as much worse.

# How far a far point may land off, px rms over the calibrated cone: that a camera is good, and that it is of use. What
# a camera states of itself is right within a factor of two, so that these are limits of the true error as well.
UNCERTAIN = (0.5, 2.0)
# And px in the worst place: four times the rms of a good camera, which is twice what is usual.
WORST = 2.0
# Median px between the corners of images that say the same: those of a camera that stands still are apart by noise,
# which is a median of 1.7 times that of a corner; three images that differ are the least a plane calibration is
# determined by, and half of the cameras of three to five were off by more than 0.3 px, the worst by 0.65.
SAME_PX = 0.5
FEWEST, FEW = 3, 6
# Part of the images that may repeat others: what they add is counted as if they were new.
REPEATED = 0.2
# The largest angle between two boards, degrees. Parallel boards were up to 35 times farther off than they state; those
# that lean 3 to 10 degrees from facing the camera, and so up to 20 against each other, are off as they state.
PARALLEL_DEG, LITTLE_TILT_DEG = 10.0, 20.0
# Relative standard deviation of the focal length from which on it is worth telling: 2 % move the rim by 2 % of it.
FOCAL = 0.02
# Part of an image's corners, and of all, that no common camera explains: some images do not belong, or many. With
# 12 % wrong corners and two boards that were counted wrongly a camera was off by 0.54 px, 1.6 times what it states.
STRAY, STRAY_OF_ALL = 0.5, (0.15, 0.3)
MANY_STRAY = 1 / 3
# Error on images held out, px: what noise of 0.5 px a coordinate leaves; and half of the corners off by so much is no
# noise but another board or lens.
HELD_OUT = (0.7, 2.0)
LARGE_PX = 2.0
# Held-out error over that of the images themselves: more means that the model bends to noise.
OVERFIT = 1.5
# What is less, px, does not matter.
MATTERS = 0.1
# Px that a spline explains and the model does not: three to five times as much, or more, is the camera then off, since
# poses and parameters hide the rest.
LEFT = (0.1, 0.5)
# Part of the held-out error that a spline saves where the model is to blame, and not chance.
POOR = 0.3
# Halves of the images may differ so many times more than noise explains; and by so many px, twice what the camera of
# all images may be off, since each has half of them and both are off.
DISAGREE = 3.0
APART = 2 * UNCERTAIN[0]
# An image that folds over within so many times the angle that corners reach is no extrapolation.
FOLDS = 1.1
# Part of what the image shows in which corners should be, and azimuths that may lack them. Nothing tests the camera
# there; those that were known were off by little even so.
COVERED = 0.6
ONE_SIDED = np.radians(150)


def pictures(e: Evidence) -> Check:
    """Ask for enough images that differ."""
    same = same_pictures(e.views)
    distinct = len(e.views) - len(same)
    sentences: list[str] = []
    level = Level(int(len(same) > REPEATED * len(e.views)))
    if same:
        more = ", ..." if len(same) > 3 else ""
        pairs = ", ".join(f"{a} = {b}" for a, b in same[:3])
        sentences.append(
            f"Images that repeat another one: {len(same)} ({pairs}{more}); they add nothing: move the board between"
            " images."
        )
    if distinct < FEWEST:
        level = Level.DO_NOT_USE
        sentences.append(
            f"{distinct} {'picture leaves' if distinct == 1 else 'pictures that differ leave'} parameters open where"
            f" the residuals are small{_left_open(e)}: take"
            " 10 to 20, with the board tilted and everywhere in the image, or a model with fewer parameters, such as"
            " --model equidistant --square-pixels."
        )
    elif distinct < FEW:
        level = Level.USABLE
        sentences.append(f"{distinct} images are few: take 10 to 20.")
    return Check("images", level, " ".join(sentences))


def tilt(e: Evidence) -> Check:
    """Ask for boards that are not parallel: only their tilt tells the focal length from their distance."""
    largest = largest_tilt(e.best.state)
    if len(e.views) < 2 or largest >= LITTLE_TILT_DEG or not e.views.planar:  # a solid body has sides of its own
        return Check("tilt")
    # Parallel boards that lean away from the axis still tell it, if the lens is wide.
    lean = float(np.degrees(np.arccos(np.clip(np.abs(e.best.state.rotations[:, 2, 2]), 0, 1))).max())
    spread = focal_relative_sigma(e.camera)
    told = lean >= LITTLE_TILT_DEG and spread is not None and spread < FOCAL
    what = (
        "so that little beside the lens's own distortion tells the focal length"
        if told
        else f"which leaves the focal length open{_focal(e.camera)}"
    )
    return Check(
        "tilt",
        Level.DO_NOT_USE if largest < PARALLEL_DEG and not told else Level.USABLE,
        f"The boards tilt only {largest:.0f} degrees against each other, {what}: take images with the board tilted by"
        " 30 to 45 degrees, to either side.",
    )


def explained(e: Evidence) -> Check:
    """Ask that the model explains the corners at all."""
    median = float(np.median(e.best.state.lengths(e.views)))
    if median <= LARGE_PX * e.scale:
        return Check("residuals")
    why = (
        "no model explains them; are they corners of one flat board, in order, all from one camera?"
        if e.auto
        else f"{e.camera.model.name} does not describe this camera: use --model auto."
    )
    return Check("residuals", Level.DO_NOT_USE, f"Half of the corners are more than {median:.1f} px off: {why}")


def strays(e: Evidence) -> Check:
    """Ask that all images are of one camera as it is now."""
    odd = [name for name, rows in zip(e.views.names, e.views.groups, strict=True) if e.outliers[rows].mean() > STRAY]
    share = float(e.outliers.mean())
    level = Level(int(bool(odd) or share > STRAY_OF_ALL[0]))
    if len(odd) >= MANY_STRAY * len(e.views) or share > STRAY_OF_ALL[1]:
        level = Level.DO_NOT_USE
    if not level:
        return Check("strays")
    named = ", ".join(odd[:5]) + (", ..." if len(odd) > 5 else "")
    where = f"Most corners of {named} lie" if odd else f"{share:.0%} of the corners lie"
    return Check(
        "strays",
        level,
        f"{where} where no common camera puts them: another camera or focus, or blur; leave those images out (--drop)"
        " and calibrate again.",
    )


def poor(e: Evidence) -> Check | None:
    """Ask that a generic camera explains images held out little better; None without one."""
    if e.spline_baseline is None:
        return None
    if not _poor(e) or _moves(e) or e.spline_baseline.left <= LEFT[0] * e.scale:
        return Check("model")
    return Check(
        "model",
        _level(e.spline_baseline.left, LEFT, e.scale),
        f"{e.camera.model.name} leaves {e.spline_baseline.left:.2f} px that a spline explains, which the stated uncertainty"
        f" does not hold: use {_another(e)}.",
    )


def viewpoint(e: Evidence) -> Check | None:
    """Ask that the rays meet in a point, or nearly; None where that was not asked."""
    moves = e.viewpoint
    if moves is None:
        return None
    if not moves.needed or explained(e).level:
        return Check("viewpoint")
    near, far = float(moves.left.rms_pixels[0]), float(moves.left.rms_pixels[-1])
    level = _level(far, UNCERTAIN, e.scale)
    return Check(
        "viewpoint",
        level,
        f"The rays do not meet in a point, so that what is {moves.distance(2)} away lands {far:.2f} px off, and"
        f" {near:.2f} px what is {moves.distance(0)} away: use --model axial."
        if level
        else "",
    )


def held_out(e: Evidence) -> Check:
    """Ask for a small error where the camera was not calibrated."""
    name = "held-out error"
    error, rms = e.best.held_out_rms, e.best.rms
    if error is None:
        return Check(name, Level.USABLE, "Too few images to hold any out, so nothing tests the camera: take 10 to 20.")
    level = _level(error, HELD_OUT, e.scale)
    if level:
        return Check(
            name,
            level,
            f"On images that it was not calibrated on the camera is {error:.2f} px off: "
            + (
                f"{e.camera.model.name} does not describe this camera; use {_another(e)}."
                if _poor(e)
                else "look at the images with the largest residuals (--draw) and leave out those that are blurred or"
                " whose board is not flat."
            ),
        )
    if error > OVERFIT * rms and error > MATTERS * e.scale:
        return Check(
            name,
            Level.USABLE,
            f"Images it was not calibrated on are {error / rms:.1f} times farther off than the others ({error:.2f} px"
            f" against {rms:.2f} px): add images, or take a model with fewer parameters.",
        )
    return Check(name)


def uncertainty(e: Evidence) -> Check:
    """Ask for a camera that is sure of itself wherever corners were seen."""
    pixels, angle, theta, phi = e.uncertainty.worst()
    if not np.isfinite(pixels):
        return Check("uncertainty", Level.DO_NOT_USE, "How sure the camera is cannot be told: take 10 to 20 images.")
    rms = e.uncertainty.rms()
    level = max(_level(rms, UNCERTAIN, e.scale), Level(int(pixels > WORST * e.scale)))
    if not level:
        return Check("uncertainty")
    return Check(
        "uncertainty",
        level,
        f"A far point would land {rms:.2g} px off, rms, and most, {pixels:.2g} px ({np.degrees(angle):.2g} degrees),"
        f" {np.degrees(theta):.0f} degrees from the axis {_side(theta, phi)}: put the board there, tilted by 30 to 45"
        " degrees.",
    )


def coverage(e: Evidence) -> Check:
    """Ask for corners all around the camera and not on a single side only."""
    c = e.coverage
    if c.gap >= ONE_SIDED:
        return Check(
            "coverage",
            Level.USABLE,
            f"The corners leave {np.degrees(c.gap):.0f} degrees around the axis empty: put the board at"
            f" {c.empty_side()}.",
        )
    if c.share < COVERED:
        return Check(
            "coverage",
            Level.USABLE,
            f"Corners were seen in {c.share:.0%} of what the image shows: put the board {c.missing()}.",
        )
    return Check("coverage")


def rim(e: Evidence) -> Check:
    """Ask for a model whose image does not fold over just where the corners end."""
    folds, reach = e.camera.model.fold_angle, e.camera.theta_max or 0.0
    if folds >= FOLDS * reach or folds >= np.pi - 1e-6 or np.isfinite(e.camera.angle_of(e.camera.border())).all():
        return Check("rim")
    return Check(
        "rim",
        Level.USABLE,
        f"The model's image folds over {np.degrees(folds):.0f} degrees from the axis, and corners reach"
        f" {np.degrees(reach):.0f}: put the board farther out, or try another --model.",
    )


def halves(e: Evidence) -> Check | None:
    """Ask that two halves of the images agree as noise has it, or say what else is at work; None without them."""
    h = e.split_half
    if h is None:
        return None
    if h.ratio <= DISAGREE or h.difference <= MATTERS * e.scale:
        return Check("halves")
    why = (
        "the rays do not meet in a point: use --model axial."
        if _moves(e)
        else f"the model is too poor for this lens: try {_another(e)}."
        if _poor(e)
        else "boards that are not flat, squares that are not square, a lens that refocused, or blur; the stated"
        " uncertainty allows for it: see with --draw which images it is, and leave them out (--drop)."
    )
    return Check(
        "halves",
        Level.USABLE if h.difference > APART * e.scale else Level.GOOD,
        f"Two halves of the images give cameras {h.difference:.2f} px apart, {h.ratio:.1f} times what corner noise"
        f" explains: {why}",
    )


def shutter(e: Evidence) -> Check:
    """Ask that nothing moved while the rows of an image were read, or say that it is why the camera is not sure."""
    found = None if _poor(e) else rolling_shutter(e.best.state, e.views)
    sentence = "" if found is None else found.sentence
    # What is stated holds it: in what is measured a camera was off as it says.
    return Check("shutter", Level(int(bool(sentence) and uncertainty(e).level > Level.GOOD)), sentence)


CHECKS = (pictures, tilt, explained, poor, viewpoint, strays, held_out, uncertainty, coverage, rim, halves, shutter)


def same_pictures(views: Observations) -> list[tuple[str, str]]:
    """Give the pairs of views whose corners are the same but for noise, (the first, its repetition)."""
    found: list[tuple[str, str]] = []
    for i, rows in enumerate(views.groups):
        for j in range(i):
            other = views.groups[j]
            a, b = views.pixels[rows], views.pixels[other]
            if a.shape == b.shape and np.median(np.linalg.norm(a - b, axis=1)) < SAME_PX:
                found.append((views.names[j], views.names[i]))
                break
    return found


def largest_tilt(state: State) -> float:
    """Give the largest angle (degrees) between the planes of two boards."""
    normals = state.rotations[:, :, 2]
    return float(np.degrees(np.arccos(np.clip(np.abs(normals @ normals.T), 0, 1))).max())


def _poor(e: Evidence) -> bool:
    """Say whether the model is to blame for a good part of the error."""
    return e.spline_baseline is not None and e.spline_baseline.left > POOR * (e.best.held_out_rms or 0.0)


def _moves(e: Evidence) -> bool:
    """Say whether the viewpoint moves along the axis, as the images have it."""
    return e.viewpoint is not None and e.viewpoint.needed


def _another(e: Evidence) -> str:
    """Name the model to take instead."""
    if _moves(e):
        return "--model axial"
    return "--model spline" if e.auto else "--model auto or --model spline"


def _focal(camera: Camera) -> str:
    """Say how open the focal length is, where it is by more than 2 %."""
    spread = focal_relative_sigma(camera)
    if spread is None or spread < FOCAL:
        return ""
    return f" (+-{100 * spread:.0f} %)" if spread < 10 else " (+-1000 % or more)"


def _left_open(e: Evidence) -> str:
    names = unidentifiable_parameters(e.camera)
    return f" ({', '.join(names)})" if names else ""


def _level(value: float, limits: tuple[float, float], scale: float) -> Level:
    return Level(int(value > limits[0] * scale) + int(value > limits[1] * scale))


def _side(theta: float, phi: float) -> str:
    if theta < 1e-6:
        return "in the middle"
    return f"at the {SIDES[round(phi / (2 * np.pi / SECTORS)) % SECTORS]}"
