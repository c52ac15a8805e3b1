"""Image retrieval: images of the same place, found by their keypoints, whatever the orientation of the camera."""

from omnisight.places.place_index import Place, PlaceIndex, similar_pairs

__all__ = ["Place", "PlaceIndex", "similar_pairs"]
