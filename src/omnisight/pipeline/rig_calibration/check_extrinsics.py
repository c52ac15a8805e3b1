"""Check of the extrinsics of a rig by matches between simultaneous images of its cameras."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.features import Keypoints, detect_features, match_features
from omnisight.geometry.pose import Pose
from omnisight.pipeline.inputs.central_camera import fit_camera
from omnisight.pipeline.inputs.photo import ImageSource, read_source
from omnisight.rig import Rig

Array = NDArray[np.float64]

# A match is consistent if its bearings are this near to a common epipolar plane: several times the errors of keypoints
# and calibrations (0.1 degrees), and a random match of the whole sphere is so near in 1 % of the cases.
MAX_ANGLE_RAD = float(np.radians(0.5))
SIGNIFICANCE = 1e-3  # of the sign test between the poses and their inverse
# The poses explain the images if at least this share of the matches is consistent; of raw matches with the right poses
# it is 57 to 87 % (OmniMVS), with the inverse at most 10 %.
MIN_SHARE = 0.3
MIN_MATCHES = 15


@dataclass(frozen=True)
class PairCheck(Displayed):
    """Matches between the images of two cameras of a rig.

    Attributes
    ----------
    a, b
        Names of the cameras.
    matches
        Number of matches.
    consistent, inverted
        Number of matches that are consistent with the pose of the rig, and with that of the inverted rig.
    """

    a: str
    b: str
    matches: int
    consistent: int
    inverted: int


@dataclass(frozen=True)
class ExtrinsicsCheck(Displayed):
    """Whether the extrinsics of a rig agree with images.

    Attributes
    ----------
    verdict
        "consistent", "inverted", "wrong" (neither the poses nor their inverse agree) or "unknown".
    reason
        The verdict in words, with the fix.
    pairs
        The pairs of cameras.
    """

    verdict: str
    reason: str
    pairs: tuple[PairCheck, ...]

    def __bool__(self) -> bool:
        """Return whether the extrinsics are consistent with the images."""
        return self.verdict == "consistent"


def check_extrinsics(rig: Rig, images: Sequence[ImageSource]) -> ExtrinsicsCheck:
    """Count the matches that agree with the epipolar geometry of a rig, and of the rig with inverted poses.

    Many programs write rig_from_sensor where another one expects sensor_from_rig. The two hypotheses are compared by
    the sign test of their numbers of matches.

    Parameters
    ----------
    rig
        The rig, of central cameras.
    images
        A simultaneous image of each camera, in the order of the cameras.

    Raises
    ------
    ValueError
        If the number or the sizes of the images do not fit the rig, or a camera is non-central.
    """
    if len(images) != len(rig):
        raise ValueError(f"{len(images)} images for {len(rig)} cameras: specify one of each, of {', '.join(rig.names)}")
    if len(rig) < 2:
        raise ValueError("the rig has one camera: there are no extrinsics to check")
    keypoints = [_keypoints(*pair) for pair in zip(rig.names, rig.cameras, images, strict=True)]
    inverse = rig.inverted()
    pairs = [_check_pair(rig, inverse, keypoints, i, j) for i in range(len(rig)) for j in range(i + 1, len(rig))]
    return _verdict(tuple(pairs))


def _keypoints(name: str, camera: Any, image: ImageSource) -> Keypoints:
    """Return the keypoints of the image of a camera."""
    if not isinstance(camera, Camera):
        raise ValueError(f"{name} is a non-central camera ({camera.model.name}), whose extrinsics cannot be checked")
    label, pixels = read_source(image, f"image of {name}", False)
    size = pixels.shape[1], pixels.shape[0]
    return detect_features(pixels, fit_camera(camera, size, label, scale=False))


def _check_pair(rig: Rig, inverse: Rig, keypoints: Sequence[Keypoints], i: int, j: int) -> PairCheck:
    """Match two images and count."""
    pairs = match_features(keypoints[i], keypoints[j]).pairs
    a, b = keypoints[i].bearings[pairs[:, 0]], keypoints[j].bearings[pairs[:, 1]]
    counts = [int(is_epipolar(a, b, body.relative_pose(i, j).pose).sum()) for body in (rig, inverse)]
    return PairCheck(rig.names[i], rig.names[j], len(pairs), *counts)


def is_epipolar(a: Array, b: Array, b_from_a: Pose) -> NDArray[np.bool_]:
    """Return which matched bearings (N, 3) are near the same epipolar half-plane.

    The angle of b to the plane of the baseline and of a is within `MAX_ANGLE_RAD`, and the rays meet at positive
    distances or nearly so.
    """
    turned, t = a @ b_from_a.rotation.T, b_from_a.translation
    length = float(np.linalg.norm(t))
    if not length:  # a pure rotation
        return np.linalg.norm(turned - b, axis=1) <= MAX_ANGLE_RAD
    t = t / length
    normal = np.cross(t, turned)
    sine = np.linalg.norm(normal, axis=1)
    distance = np.abs((normal * b).sum(1)) / np.maximum(sine, MAX_ANGLE_RAD)
    # From the direction of the point at infinity towards the centre of camera a: the order of angles to t.
    angle_a, angle_b = (np.arccos(np.clip(v @ t, -1, 1)) for v in (turned, b))
    same_side = (np.cross(t, b) * normal).sum(1) >= 0
    return (distance <= MAX_ANGLE_RAD) & same_side & (angle_b <= angle_a + MAX_ANGLE_RAD)


def _verdict(pairs: tuple[PairCheck, ...]) -> ExtrinsicsCheck:
    """Compare both hypotheses over all pairs with enough matches."""
    usable = [pair for pair in pairs if pair.matches >= MIN_MATCHES]
    matches = sum(pair.matches for pair in usable)
    if not usable:
        reason = f"too few matches between the images (at most {max(p.matches for p in pairs)}): use other images"
        return ExtrinsicsCheck("unknown", reason, pairs)
    right, wrong = sum(pair.consistent for pair in usable), sum(pair.inverted for pair in usable)
    figures = f"{right} of {matches} matches agree with the extrinsics, {wrong} with their inverse"
    if max(right, wrong) < MIN_SHARE * matches:
        reason = f"{figures}: wrong cameras or poses, images of other instants, or another order of the images"
        return ExtrinsicsCheck("wrong", reason, pairs)
    if 2 * bdtrc(max(right, wrong) - 1, right + wrong, 0.5) > SIGNIFICANCE:
        reason = f"{figures}: no significant difference; use images with more texture in the common field of view"
        return ExtrinsicsCheck("unknown", reason, pairs)
    if wrong > right:
        reason = f"{figures}: the poses are inverted; fix: omnisight convert FILE --to native --invert-extrinsics"
        return ExtrinsicsCheck("inverted", reason, pairs)
    return ExtrinsicsCheck("consistent", figures, pairs)
