"""Files that are no text: as text whose characters are the bytes."""

from pathlib import Path

from omnisight.formats._protocol import FormatError

HEADS = ("PK\x03\x04", "\x93NUMPY", "MATLAB ", "\x89HDF")  # of zip, numpy, MATLAB 5 and HDF5
HEAD = 64
LARGEST = 50_000_000  # bytes; a calibration file is a few kilobytes


def to_text(data: bytes) -> str:
    """Give a file's text; of a file that is none, its bytes as characters 0 to 255."""
    if is_binary(data[: 2 * HEAD].decode("latin-1")):
        return data.decode("latin-1")
    # PowerShell's `>` writes UTF-16.
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    return data.decode(encoding, errors="replace")


def to_bytes(text: str) -> bytes:
    """Give the bytes of what `to_text` gave."""
    return text.encode("latin-1") if is_binary(text) else text.encode()


def is_binary(text: str) -> bool:
    """Say whether a file that begins so is none of text: UTF-16 has zeros too, and a mark before them."""
    if text[:2] in ("\xff\xfe", "\xfe\xff"):
        return False
    return text.startswith(HEADS) or "\0" in text[:HEAD]


def read_file(path: Path) -> str:
    """Give the text of a file; `FormatError` says why it cannot be read."""
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise FormatError(f"{path}: is a folder, not a calibration file")
        if size > LARGEST:
            raise FormatError(f"{path}: {size} bytes; a calibration file has at most {LARGEST}")
        text = to_text(path.read_bytes())
    except OSError as error:
        raise FormatError(f"{path}: {error.strerror}") from error
    if not text.strip():
        raise FormatError(f"{path}: empty file")
    return text
