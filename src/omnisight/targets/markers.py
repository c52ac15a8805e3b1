"""Finds boards with markers: the markers say which point is which, the fit of two crossing edges where it is.

A marker knows its neighbourhood only. From the markers around it each point is predicted by a smooth local map, then
measured where two edges cross; measured points predict the next ones, so points whose marker is too small or too bent
to be decoded are found as well. Nothing assumes that the lens keeps straight lines straight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from .boards.aprilgrid import AprilGrid
from .boards.charuco import Charuco
from .decoding import Markers, decode, linked
from .detection import Detection
from .grids.crossing import Crossings
from .local_map import local_map
from .marker_sheets import Sheet, aprilgrid_sheet, charuco_sheet, charuco_variants

Array = NDArray[np.float64]

_LEAST_MARKERS = 2
_LEAST_POINTS = 4

_EXPLAINED = 0.6
"""Share of the image's variation around a point that two crossing edges must explain."""

_VAGUE = 0.4
"""Standard deviation in px above which a point is worth nothing, such as one whose window the image's edge cuts."""

_FAINTEST = 0.2
"""Least contrast of a point, over the median of those that are sure."""

_MOVED = 0.5
"""How far a point may be from its prediction, over the distance to the next point, which has its colours the other way
around: so it is never taken for this one."""

_MARGIN = 4.0
"""Distance in px from the image's edge within which nothing is measured: blur and sharpening go wrong there."""

_SEARCH = 0.3
"""Distance, over that to the next point, at which a point is looked for that was not where it was expected."""
_AROUND = np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)], np.float64)

_STRAY = 0.18
"""How far a point may be from where its neighbours expect it, over the distance to the next; or, where they scatter
more, `_STRAY_SCATTER` times their median distance from theirs."""
_STRAY_SCATTER = 5.0
_PASSES = 3

_MARKER_WEIGHT = 0.02
"""What a decoded marker's corner, a pixel off, counts against a measured point."""

_NUDGE = 0.3
"""How far in px off its place a point's second measurement begins: the fit ends once it stands still, which it does at
once where it begins right, before it knows the blur."""

_ROUNDS = 12
"""How often measured points may predict further ones: a step each time."""


def detect_charuco(gray: NDArray[np.uint8], board: Charuco) -> list[Detection]:
    """Find a ChArUco board.

    Where the image is a mirror image, as a camera sees a board in a mirror, so are the points: ids are right, and
    the step to the next row is anticlockwise of the step to the next column. Where the markers are those of the other
    layout, or of a board with columns and rows swapped, that board is found: the note of the detection says so, and
    ids are those of the board that was asked for.

    Parameters
    ----------
    gray : (H, W) array of uint8
    board : Charuco

    Returns
    -------
    list of Detection
        One, or none.
    """
    variants = charuco_variants(board)
    sheets = [charuco_sheet(variant) for variant, _, _ in variants]
    markers = decode(
        gray,
        board.dictionary,
        max(len(sheet.places) for sheet in sheets),
        1,
        lambda found: max(len(_of(found, sheet).ids) == len(sheet.places) for sheet in sheets),
    )
    ours = [_of(markers, sheet) for sheet in sheets]
    # Another board must fit clearly better: within one row of markers, both layouts are the same but for a shift.
    best = max(range(len(ours)), key=lambda k: (len(ours[k].ids) - (k > 0), -k))
    _, numbers, note = variants[best]
    found = _measured(gray, ours[best], sheets[best])
    if found is None:
        return []
    ids = numbers[found.ids]
    order = np.argsort(ids)
    return [Detection(ids[order], found.pixels[order], found.covariance[order], note=note, board=board)]


def detect_aprilgrid(gray: NDArray[np.uint8], board: AprilGrid) -> list[Detection]:
    """Find an AprilGrid; of a mirror image as `detect_charuco` does.

    Parameters
    ----------
    gray : (H, W) array of uint8
    board : AprilGrid

    Returns
    -------
    list of Detection
        One, or none.
    """
    sheet = aprilgrid_sheet(board)
    count = len(sheet.places)
    markers = decode(gray, board.dictionary, count, board.border, lambda m: len(_of(m, sheet).ids) == count)
    found = _measured(gray, _of(markers, sheet), sheet)
    return [] if found is None else [found]


def _of(markers: Markers, sheet: Sheet) -> Markers:
    known = markers.ids < len(sheet.places)
    return linked(Markers(markers.ids[known], markers.corners[known]), sheet.places)


def _measured(gray: NDArray[np.uint8], markers: Markers, sheet: Sheet) -> Detection | None:
    """Measure the points around the markers, and on from there."""
    if len(markers.ids) < min(_LEAST_MARKERS, len(sheet.places)):
        return None
    count = len(sheet.points)
    pixels, amplitude = np.full((count, 2), np.nan), np.full(count, np.nan)
    places, corners = sheet.places[markers.ids].reshape(-1, 2), markers.corners.reshape(-1, 2)
    tried = np.zeros(count, np.int64)
    for _ in range(_ROUNDS):
        there = np.isfinite(pixels[:, 0])
        anchors = np.concatenate([places, sheet.points[there]])
        seen = np.concatenate([corners, pixels[there]])
        weights = np.where(np.arange(len(anchors)) < len(places), _MARKER_WEIGHT, 1.0)
        near = KDTree(anchors).query(sheet.points)[0] < 1.1 * sheet.step
        wanted = np.flatnonzero(near & ~there & (tried < 4))
        if not len(wanted):
            break
        tried[wanted] += 1
        guess = local_map(anchors, seen, weights, sheet.points[wanted], sheet.pitch)
        window = guess.window(sheet.board.reach)
        room = _MOVED * sheet.gap * _shortest(guess.jacobian)
        sure = np.abs(amplitude[there])
        for away in _AROUND:
            left = ~np.isfinite(pixels[wanted, 0]) & ((tried[wanted] > 1) | (away == 0).all())
            start = guess.pixels + guess.jacobian @ (away * _SEARCH * sheet.gap)
            fit = sheet.board.measure(gray, np.where(left[:, None], start, np.nan), *window)
            good = _judged(gray, fit, guess.pixels, room, sheet.bright[wanted], sure)
            pixels[wanted[good]], amplitude[wanted[good]] = fit.pixels[good], fit.amplitude[good]
        if not np.isfinite(pixels).any():
            break
    return _confirmed(gray, pixels, sheet)


def _judged(
    gray: NDArray[np.uint8], fit: Crossings, guess: Array, room: Array, bright: NDArray[np.bool_], sure: Array
) -> NDArray[np.bool_]:
    """Say which fits are the points that were looked for, near their guess and with the contrast of the sure ones."""
    good = (fit.explained > _EXPLAINED) & ((fit.amplitude > 0) == bright)
    good &= np.linalg.norm(fit.pixels - guess, axis=1) < room
    inside = (fit.pixels > _MARGIN) & (fit.pixels < np.array(gray.shape[::-1]) - 1 - _MARGIN)
    good &= inside.all(axis=1) & (np.trace(fit.covariance, axis1=1, axis2=2) < _VAGUE**2)
    strength = np.abs(fit.amplitude)
    usual = np.median(sure) if len(sure) else np.median(strength[good]) if good.any() else 0.0
    return good & (strength > _FAINTEST * usual)


def _shortest(jacobian: Array) -> Array:
    """Give the least of the lengths in px of a unit along the board's x and along its y."""
    return np.linalg.norm(jacobian, axis=1).min(axis=1)


def _confirmed(gray: NDArray[np.uint8], pixels: Array, sheet: Sheet) -> Detection | None:
    """Measure the points again, each window laid by the others; drop those that the others do not expect there."""
    for _ in range(_PASSES):
        there = np.flatnonzero(np.isfinite(pixels[:, 0]))
        if len(there) < _LEAST_POINTS:
            return None
        points = sheet.points[there]
        others = local_map(points, pixels[there], np.ones(len(there)), points, sheet.pitch, leave_out=True)
        room = sheet.gap * _shortest(others.jacobian)
        stray = np.linalg.norm(others.pixels - pixels[there], axis=1) / room
        stray[~np.isfinite(stray)] = np.inf
        # No two points are at one place: of such a pair the one that its neighbours expect less.
        apart, nearest = (np.asarray(a)[:, 1] for a in KDTree(pixels[there]).query(pixels[there], k=2))
        double = (apart < 0.5 * room) & (stray >= stray[nearest])
        bad = double | (stray > max(_STRAY, _STRAY_SCATTER * float(np.median(stray))))
        if not bad.any():
            break
        # One stray point makes its neighbours look so: first the worst of all, those around it are judged again.
        pixels[there[bad & (double | (stray > 0.5 * stray.max()))]] = np.nan
    there = np.flatnonzero(np.isfinite(pixels[:, 0]))
    if len(there) < _LEAST_POINTS:
        return None
    points = sheet.points[there]
    near = local_map(points, pixels[there], np.ones(len(there)), points, sheet.pitch)
    fit = sheet.board.measure(gray, pixels[there], *near.window(sheet.board.reach))
    room = _MOVED * sheet.gap * _shortest(near.jacobian)
    good = _judged(gray, fit, pixels[there], room, sheet.bright[there], np.zeros(0))
    if good.sum() < _LEAST_POINTS:
        return None
    return Detection(there[good], fit.pixels[good], fit.covariance[good], board=sheet.board)
