"""Keypoints with bearings and covariances in the image of any camera, and their matching."""

from omnisight.features.detection import FeatureOptions, detect_features
from omnisight.features.keypoints import Keypoints
from omnisight.features.matching import Matches, match_features, match_guided

__all__ = ["FeatureOptions", "Keypoints", "Matches", "detect_features", "match_features", "match_guided"]
