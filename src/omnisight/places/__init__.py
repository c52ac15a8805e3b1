"""Image retrieval: images of the same place, found by their keypoints, whatever the orientation of the camera."""

from omnisight.places.place_index import Place, PlaceIndex, similar_pairs
from omnisight.places.verification import PlaceMatch, verify_place

__all__ = ["Place", "PlaceIndex", "PlaceMatch", "similar_pairs", "verify_place"]
