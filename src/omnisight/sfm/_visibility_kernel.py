"""Compiled visibility of the points of an image in another image."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np

from omnisight.compiled import njit_driver, njit_helper

# Change of the direction to a point, and of the logarithm of its distance, up to which keypoints match, and changes by
# which the number of matches decreases to 1/e: in rendered rooms and streets, and real photos of a board.
MAX_TURN_RAD, MAX_LOG_RATIO = float(np.radians(45.0)), float(np.log(2.0))
TURN_DECAY_RAD, LOG_RATIO_DECAY = float(np.radians(40.0)), 0.6
# A point farther than the surface in its direction by this factor is hidden.
HIDDEN_RATIO = 1.3


@njit_driver
def mark_visible(bearings, distances, rotation, translation, farthest, cells, seen):
    """Mark the points (N,) that another image with a pose other_from_this should match; return how many will.

    Parameters
    ----------
    bearings, distances
        (N, 3) and (N,) of the points.
    rotation, translation
        (3, 3) and (3,) of the pose.
    farthest
        (6 cells^2,) distance in each cell of the other image; 0 without a keypoint.
    cells
        Number of cells along each edge of a cube.
    seen
        (N,) of bool, which are filled.
    """
    number = 0.0
    direction = np.empty(3)
    for n in range(len(distances)):
        seen[n] = False
        cosine, squares = 0.0, 0.0
        for i in range(3):
            turned = rotation[i, 0] * bearings[n, 0] + rotation[i, 1] * bearings[n, 1] + rotation[i, 2] * bearings[n, 2]
            direction[i] = distances[n] * turned + translation[i]
            cosine += turned * direction[i]
            squares += direction[i] ** 2
        distance = max(np.sqrt(squares), 1e-300)
        turn = np.arccos(min(max(cosine / distance, -1.0), 1.0))
        log_ratio = abs(np.log(distance / distances[n]))
        if turn > MAX_TURN_RAD or log_ratio > MAX_LOG_RATIO:
            continue
        if farthest[cell_of(direction, cells)] * HIDDEN_RATIO >= distance:
            seen[n] = True
            number += np.exp(-turn / TURN_DECAY_RAD - log_ratio / LOG_RATIO_DECAY)
    return number


@njit_helper
def cell_of(direction, cells):
    """Return the cell of a cube that a direction (3,) passes."""
    axis = 0
    for i in range(1, 3):
        if abs(direction[i]) > abs(direction[axis]):
            axis = i
    along = abs(direction[axis])
    cell = 2 * axis + (direction[axis] < 0)
    for i in range(1, 3):
        across = np.arctan(direction[(axis + i) % 3] / along) * (4 / np.pi)
        cell = cell * cells + min(int((across + 1) * (cells / 2)), cells - 1)
    return cell
