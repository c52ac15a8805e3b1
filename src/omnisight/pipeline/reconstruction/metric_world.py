"""Known measurements in metres: the distance of two images, or positions of images."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from omnisight.images import GeodeticPosition
from omnisight.pipeline.inputs.camera_sources import CameraSources
from omnisight.pipeline.inputs.image_set import ImageSet
from omnisight.pipeline.reconstruction.known_positions import KnownPositions, image_named, read_positions
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions
from omnisight.sfm.georeference import Georeference, georeferenced, scaled
from omnisight.sfm.map import Map
from omnisight.targets.length import parse_length


@dataclass(frozen=True, eq=False)
class MetricWorld:
    """Measurements that bring maps into metres; at most one of them.

    Attributes
    ----------
    positions
        Known positions of images.
    distance
        Indices of two images, and their distance in metres.
    """

    positions: KnownPositions | None = None
    distance: tuple[int, int, float] | None = None

    @classmethod
    def of(cls, files: ImageSet, sources: CameraSources, options: ReconstructOptions) -> Self:
        """Read the options `positions` and `scale`.

        Raises
        ------
        ValueError
            If an image is unknown, both are the same, a length has no unit, no position can be read, or the rig
            determines the scale or is not in metres.
        """
        if sources.has_scale and sources.unit != "m":
            raise ValueError(
                f"the lengths of the rig are in {sources.unit}, not metres: use a rig that was calibrated with --square"
                " or reconstructed with --scale or --positions, or specify --extrinsics unknown, which estimates its"
                " poses"
            )
        if options.positions is not None:
            return cls(positions=read_positions(options.positions, files))
        if options.scale is None:
            return cls()
        if sources.has_scale:
            raise ValueError("the distances between the cameras of the rig determine the scale: leave scale out")
        *names, length = options.scale
        a, b = (image_named(files, name) for name in names)
        if a == b:
            raise ValueError(f"--scale {' '.join(options.scale)}: specify two different images")
        return cls(distance=(a, b, parse_length(length, "--scale")))

    @property
    def is_known(self) -> bool:
        """Whether anything was measured in metres."""
        return self.positions is not None or self.distance is not None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Measurements that are not used."""
        return () if self.positions is None else self.positions.warnings

    @property
    def origin(self) -> GeodeticPosition | None:
        """Origin of the world on the ellipsoid WGS 84."""
        return None if self.positions is None else self.positions.origin

    def place(self, maps: Sequence[Map]) -> tuple[list[Map], tuple[Georeference, ...]]:
        """Return the maps in metres, as far as the measurements determine them."""
        if self.positions is not None:
            placed = [georeferenced(found, self.positions.positions) for found in maps]
        elif self.distance is not None:
            placed = [scaled(found, *self.distance) for found in maps]
        else:
            return list(maps), ()
        return [found for found, _ in placed], tuple(georeference for _, georeference in placed)
