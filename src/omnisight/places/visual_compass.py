"""Visual compass: the heading of a panorama relative to the most similar of several references."""

from collections.abc import Sequence

import numpy as np

from omnisight.places.panorama_rotation import CompassRotation, correlations, estimate_rotation
from omnisight.places.panorama_signature import PanoramaSignature


class VisualCompass:
    """Headings of panoramas relative to references.

    D. Scaramuzza and R. Siegwart, Appearance-guided monocular omnidirectional visual odometry for outdoor ground
    vehicles, IEEE Trans. Robotics 24(5), 2008; J. Zeil et al., Catchment areas of panoramic snapshots in outdoor
    scenes, J. Opt. Soc. Am. A 20(3), 2003.

    Parameters
    ----------
    references
        Panoramas of the same size, which are not uniform.
    """

    def __init__(self, references: Sequence[PanoramaSignature]) -> None:
        self.references = references

    def locate(self, query: PanoramaSignature, excluded: int | None = None) -> tuple[int, CompassRotation]:
        """Return the index of the most similar reference and the rotation from it.

        Parameters
        ----------
        query
            A panorama of the size of the references.
        excluded
            Reference to leave out, such as the query itself.
        """
        found = correlations(query, self.references)
        similarity = found.max(axis=1)
        if excluded is not None:
            similarity[excluded] = -np.inf
        nearest = int(similarity.argmax())
        return nearest, estimate_rotation(query, self.references[nearest], found[nearest])
