"""The images that a capture has stored, the camera that they determine so far, and what a further image adds."""

from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.frame_information import (
    MIN_DISPLACEMENT,
    MOTION_OF_NOISE_PX,
    PRIOR_INFORMATION,
    sufficient_gain,
    view_displacements,
    view_information,
)
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.resection import resect
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.sphere import angle_from_axis
from omnisight.images import downsample, estimate_image_field
from omnisight.quality.coverage import Coverage
from omnisight.targets import Board, Detection, Detections, ImageDetection
from omnisight.targets.clip_detection import CandidateFrame, detect_in_frame
from omnisight.targets.observations import Observations
from omnisight.view_planning.information_prior import InformationPrior
from omnisight.view_planning.proposal import Proposal, propose_views

Array = NDArray[np.float64]

# Images from which a preliminary camera is estimated: the least number of a calibration.
MIN_VIEWS = 3
# Detections whose sharpness is compared.
COMPARED_DETECTIONS = 50
# The Laplacian energy of an edge falls with the third power of its blur: below this share of the median, an image is
# twice as blurred.
MIN_SHARPNESS_SHARE = 1 / 8


@dataclass(frozen=True, eq=False)
class JudgedCandidate:
    """A candidate with its detection, and whether it is stored.

    Attributes
    ----------
    candidate
        The frame.
    detection
        The board; None if there is none.
    advice
        Why the image is not stored, as an advice; empty if it is.
    """

    candidate: CandidateFrame
    detection: Detection | None
    advice: str


@dataclass(eq=False)
class CaptureSession(Displayed):
    """Decides which images to store.

    Attributes
    ----------
    board
        The board.
    detections
        Those of the stored images.
    proposal
        The camera so far, and where to hold the board next; None with too few images, or if no camera fits them.
    coverage
        The directions with corners; None without a camera.
    """

    board: Board
    detections: Detections = field(init=False)
    proposal: Proposal | None = None
    coverage: Coverage | None = None
    _sharpness: deque[float] = field(default_factory=lambda: deque[float](maxlen=COMPARED_DETECTIONS))
    _thumbnails: list[NDArray[np.uint8]] = field(default_factory=list[NDArray[np.uint8]])
    _information: Array | None = None

    def __post_init__(self) -> None:
        """Start without images."""
        self.detections = Detections(self.board)

    def judge(self, candidate: CandidateFrame) -> JudgedCandidate:
        """Detect the board in a frame, and judge whether it is sharp, still and informative."""
        found = detect_in_frame(candidate, self.board)
        detection = max(found.boards, key=len, default=None)
        return JudgedCandidate(candidate, detection, self._advice(candidate, detection, found.motion))

    def add(self, judged: JudgedCandidate, path: Path) -> None:
        """Add a stored image."""
        assert judged.detection is not None
        gray = judged.candidate.gray
        size = gray.shape[1], gray.shape[0]
        self._thumbnails.append(downsample(gray))
        images = [*self.detections.images, ImageDetection(path, size, (judged.detection,))]
        field = estimate_image_field(self._thumbnails).resized(size)
        self.detections = Detections(self.board, images, field=field)

    def estimate(self) -> None:
        """Estimate the camera from the stored images, its coverage, and where to hold the board next."""
        observations, size = Observations.from_detections(self.detections), self.detections.size
        if len(observations) < MIN_VIEWS:
            return
        try:
            state = estimate_initial_camera(observations)
            theta = float(angle_from_axis(state.points(observations)[0]).max())
            prior = InformationPrior.estimate(Camera(state.central_model, size, theta_max=theta), observations)
        except ValueError:  # the first images may fit no camera; further ones will
            return
        self.proposal = propose_views(prior, self.board, self.detections.field, count=1)
        self.coverage = Coverage.of(prior.camera, prior.state, observations)
        self._information = view_information(prior.state, observations).sum(0)

    def _advice(self, candidate: CandidateFrame, detection: Detection | None, motion: float) -> str:
        """Return why an image is not stored; empty if it is to be."""
        if detection is None:
            return "show the board"
        sharpness = _edge_sharpness(candidate.gray, detection)
        self._sharpness.append(sharpness)
        if motion > MOTION_OF_NOISE_PX:
            return "hold the board still"
        if sharpness < MIN_SHARPNESS_SHARE * float(np.median(self._sharpness)):
            return "blurred: hold the board still, or focus"
        if not self._is_informative(detection):
            return "move the board: this pose adds nothing new"
        return ""

    def _is_informative(self, detection: Detection) -> bool:
        """Return whether the board is elsewhere than in all stored images, and adds information about the camera."""
        if not self.detections.images:
            return True
        image = ImageDetection(Path("new"), self.detections.size, (detection,))
        views = Observations.from_detections(Detections(self.board, [*self.detections.images, image]))
        if view_displacements(views)[-1, :-1].min() <= MIN_DISPLACEMENT * views.size[0]:
            return False
        if self._information is None or self.proposal is None:
            return True
        new = views.subset([len(views) - 1])
        (added,) = view_information(resect(self.proposal.prior.camera.model, new), new)
        prior = PRIOR_INFORMATION * np.diag(np.maximum(np.diagonal(self._information), 1e-300))
        before, after = (
            np.linalg.slogdet(total + prior)[1] for total in (self._information, self._information + added)
        )
        return bool(after - before >= sufficient_gain(len(added)))


def _edge_sharpness(gray: Any, detection: Detection) -> float:
    """Return the Laplacian energy over the contrast energy on a board, per length of its edges in the image."""
    import cv2
    from scipy.spatial import KDTree

    (left, top), (right, bottom) = detection.pixels.min(0), detection.pixels.max(0)
    part = gray[max(int(top), 0) : int(bottom) + 2, max(int(left), 0) : int(right) + 2]
    spacing = float(np.median(KDTree(detection.pixels).query(detection.pixels, k=2)[0][:, 1]))
    return float(cv2.Laplacian(part, cv2.CV_32F).var() / max(float(part.var()), 1.0)) * spacing
