"""GPano tags of equirectangular photos: an XMP packet in a JPEG file, with which viewers show a sphere.

Namespace http://ns.google.com/photos/1.0/panorama/ (Google, Photo Sphere XMP Metadata).
"""

import re
from typing import NamedTuple

from omnisight.images.headers import APP1, JPEG_MAGIC, jpeg_segments, with_app1

_XMP = b"http://ns.adobe.com/xap/1.0/\0"


class SpherePart(NamedTuple):
    """The part of a whole sphere that an image shows.

    Attributes
    ----------
    whole
        (width, height) of the image of the whole sphere, px.
    offset
        Column and row of the first pixel in that image.
    """

    whole: tuple[int, int]
    offset: tuple[int, int] = (0, 0)


def with_gpano(
    jpeg: bytes,
    size: tuple[int, int],
    *,
    part: SpherePart | None = None,
    heading: float | None = None,
    is_level: bool = False,
) -> bytes:
    """Return a JPEG file with the tags of a sphere.

    Parameters
    ----------
    jpeg
        The file.
    size
        (width, height), px.
    part
        The part of the sphere that it shows; None for all of it.
    heading
        Direction of the centre, degrees clockwise from north; None if it is unknown.
    is_level
        Whether the horizon is level: pitch and roll are then zero.

    Raises
    ------
    ValueError
        If the data is not a JPEG file.
    """
    if not jpeg.startswith(JPEG_MAGIC):
        raise ValueError("GPano tags are written to JPEG files only")
    (width, height), ((whole_width, whole_height), (left, top)) = size, part or SpherePart(size)
    tags: dict[str, str | int] = {
        "ProjectionType": "equirectangular",
        "UsePanoramaViewer": "True",
        "StitchingSoftware": "omnisight",
        "FullPanoWidthPixels": whole_width,
        "FullPanoHeightPixels": whole_height,
        "CroppedAreaImageWidthPixels": width,
        "CroppedAreaImageHeightPixels": height,
        "CroppedAreaLeftPixels": left,
        "CroppedAreaTopPixels": top,
    }
    if heading is not None:
        tags["PoseHeadingDegrees"] = f"{heading % 360:.3f}"
    if is_level:
        tags |= {"PosePitchDegrees": "0", "PoseRollDegrees": "0"}
    attributes = " ".join(f'GPano:{name}="{value}"' for name, value in tags.items())
    packet = (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about=""'
        f' xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" {attributes}/></rdf:RDF></x:xmpmeta>'
        '<?xpacket end="w"?>'
    )
    return with_app1(jpeg, _XMP + packet.encode())


def read_gpano(data: bytes) -> dict[str, str]:
    """Return the GPano tags of a JPEG file by name; empty if there are none."""
    if data.startswith(JPEG_MAGIC):
        for marker, payload in jpeg_segments(data):
            if marker == APP1 and payload.startswith(_XMP):
                return dict(re.findall(r'GPano:(\w+)="([^"]*)"', payload.decode("utf-8", "replace")))
    return {}
