"""Comparison of the size of an image with that of its camera."""


def is_resized(size: tuple[int, int], expected: tuple[int, int]) -> bool:
    """Return whether two sizes have the same aspect ratio, within a pixel of the smaller one."""
    (width, height), (other_width, other_height) = size, expected
    return abs(width * other_height - other_width * height) <= max(width, other_width)


def size_mismatch(size: tuple[int, int], expected: tuple[int, int]) -> str:
    """Return the message for an image whose size differs from that of its camera, with the remedy."""
    if min(expected) < 1:
        return f"the image is {size[0]}x{size[1]}, and the camera file has no image size: add it to the file"
    sizes = f"the image is {size[0]}x{size[1]}, the camera {expected[0]}x{expected[1]}"
    if is_resized(size, expected):
        ratio = size[0] / expected[0]
        return f"{sizes}: {ratio:.4g} times as large; if the image was resized, scale the camera (--scale-camera)"
    if size == expected[::-1]:
        return (
            f"{sizes}: rotated by 90 degrees; images have the EXIF orientation only with --apply-exif: specify it if"
            " the camera was calibrated with it, otherwise leave it out"
        )
    return f"{sizes}: a different aspect ratio; a camera is valid only for images like those of its calibration"


def check_size(size: tuple[int, int], expected: tuple[int, int], name: object) -> None:
    """Raise `ValueError`, with the name of the image, if its size differs from that of its camera."""
    if size != expected:
        raise ValueError(f"{name}: {size_mismatch(size, expected)}")
