"""Result of `localize`."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from omnisight.display import Displayed
from omnisight.localization.localize import LocalizedImage
from omnisight.sfm.calibration_check import FocalLengthChange


@dataclass(frozen=True, eq=False)
class LocalizationResult(Displayed, Mapping[str, LocalizedImage]):
    """The poses of images in a map, by name.

    Attributes
    ----------
    images
        For each image its pose and covariance, or the reason why it is unknown.
    focal_length_change
        The focal length that the images agree with best, if it differs significantly from that of the camera and moves
        the poses; then their covariances contain the shifts.
    """

    images: Mapping[str, LocalizedImage]
    focal_length_change: FocalLengthChange | None = None

    def __repr__(self) -> str:
        """Return the number of localized images, and the change of the focal length."""
        change = "" if self.focal_length_change is None else f", {self.focal_length_change}"
        return f"LocalizationResult({sum(map(bool, self.values()))} of {len(self)} images localized{change})"

    def __getitem__(self, name: str) -> LocalizedImage:
        """Return an image by its name."""
        return self.images[name]

    def __iter__(self) -> Iterator[str]:
        """Return the names of the images."""
        return iter(self.images)

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.images)
