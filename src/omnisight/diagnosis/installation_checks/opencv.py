"""Check of OpenCV: its build, and wheels that overwrite each other."""

from importlib import metadata

from omnisight.diagnosis.finding import Finding, Level

PRIORITY = 10


def check() -> Finding:
    """Check that exactly one distribution owns the folder cv2, and that it can be imported."""
    owners = sorted({name for name in metadata.packages_distributions().get("cv2", ()) if name})
    try:
        import cv2
    except ImportError as error:
        return Finding("OpenCV", Level.FAILED, f"cannot be imported: {error}", "pip install opencv-python-headless")
    video = "FFMPEG" in _videos(cv2)
    wheel = ", ".join(owners) or "not from a wheel"
    figure = f"OpenCV {cv2.__version__} ({wheel}), video by FFmpeg: {'yes' if video else 'no'}"
    if len(owners) > 1:
        advice = f"these overwrite each other's files: pip uninstall -y {' '.join(owners)}; pip install {owners[-1]}"
        return Finding("OpenCV", Level.FAILED, figure, advice)
    if not video:
        return Finding("OpenCV", Level.WARNING, figure, "clips cannot be read: pip install opencv-python-headless")
    return Finding("OpenCV", Level.OK, figure)


def _videos(cv2: object) -> list[str]:
    """Return the names of the video readers of OpenCV."""
    registry = getattr(cv2, "videoio_registry", None)
    if registry is None:
        return []
    return [registry.getBackendName(backend) for backend in registry.getStreamBackends()]
