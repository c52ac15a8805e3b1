"""Picture files in and out, of any depth and with hostile bytes; knows no cameras and no boards."""

from .collect import EXTENSIONS, collect_images, expand
from .field import ImageField, estimate_field, shrunk
from .gray import to_gray8
from .headers import exif_orientation
from .read import UnreadableImage, decode_image, read_bytes, read_image
from .video import CLIPS, MOST_FRAMES, Clip, Frame
from .write import write_bytes, write_image

__all__ = [
    "CLIPS",
    "EXTENSIONS",
    "MOST_FRAMES",
    "Clip",
    "Frame",
    "ImageField",
    "UnreadableImage",
    "collect_images",
    "decode_image",
    "estimate_field",
    "exif_orientation",
    "expand",
    "read_bytes",
    "read_image",
    "shrunk",
    "to_gray8",
    "write_bytes",
    "write_image",
]
