"""GPano tags of equirectangular photos: an XMP packet in a JPEG file, with which viewers show a sphere.

Namespace http://ns.google.com/photos/1.0/panorama/ (Google, Photo Sphere XMP Metadata).
"""

import re

from omnisight.images.headers import APP1, JPEG_MAGIC, jpeg_segments, with_app1

_XMP = b"http://ns.adobe.com/xap/1.0/\0"


def with_gpano(jpeg: bytes, size: tuple[int, int], *, heading: float | None = None, is_level: bool = False) -> bytes:
    """Return a JPEG file with the tags of a whole sphere.

    Parameters
    ----------
    jpeg
        The file.
    size
        (width, height), px.
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
    width, height = size
    tags: dict[str, str | int] = {
        "ProjectionType": "equirectangular",
        "UsePanoramaViewer": "True",
        "StitchingSoftware": "omnisight",
        "FullPanoWidthPixels": width,
        "FullPanoHeightPixels": height,
        "CroppedAreaImageWidthPixels": width,
        "CroppedAreaImageHeightPixels": height,
        "CroppedAreaLeftPixels": 0,
        "CroppedAreaTopPixels": 0,
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
