"""Reading and writing of images and videos, edges, and the image field. Independent of cameras and boards."""

from omnisight.images.collect import IMAGE_SUFFIXES, collect_images, expand_path
from omnisight.images.exif import GeodeticPosition, exif_orientation, exif_position
from omnisight.images.gray import to_gray8
from omnisight.images.image_field import ImageField, downsample, estimate_image_field
from omnisight.images.mask import read_mask
from omnisight.images.read import (
    UnreadableImage,
    decode_image,
    read_bytes,
    read_image,
    readable_images,
    reason_without_name,
    unreadable_warnings,
)
from omnisight.images.video import MAX_FRAMES, Clip, Frame, check_frame_rates
from omnisight.images.video_files import has_clip_suffix
from omnisight.images.write import encode_image, write_bytes, write_image

__all__ = [
    "IMAGE_SUFFIXES",
    "MAX_FRAMES",
    "Clip",
    "Frame",
    "GeodeticPosition",
    "ImageField",
    "UnreadableImage",
    "check_frame_rates",
    "collect_images",
    "decode_image",
    "downsample",
    "encode_image",
    "estimate_image_field",
    "exif_orientation",
    "exif_position",
    "expand_path",
    "has_clip_suffix",
    "read_bytes",
    "read_image",
    "read_mask",
    "readable_images",
    "reason_without_name",
    "to_gray8",
    "unreadable_warnings",
    "write_bytes",
    "write_image",
]
