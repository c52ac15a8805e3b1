"""Read files as text; a binary file becomes a text whose characters are its bytes."""

from pathlib import Path

from omnisight.extensions import file_error
from omnisight.formats._limits import MAX_FILE_BYTES
from omnisight.formats._protocol import FormatError

BINARY_SIGNATURES = ("PK\x03\x04", "\x93NUMPY", "MATLAB ", "\x89HDF")  # of zip, NumPy, MATLAB 5 and HDF5
SIGNATURE_CHARS = 64
UTF16_MARKS = ("\xff\xfe", "\xfe\xff")


def decode(data: bytes) -> str:
    """Return the text of a file, or the bytes of a binary file as characters 0 to 255."""
    if is_binary(data[: 2 * SIGNATURE_CHARS].decode("latin-1")):
        return data.decode("latin-1")
    # PowerShell's `>` writes UTF-16.
    encoding = "utf-16" if data[:2].decode("latin-1") in UTF16_MARKS else "utf-8-sig"
    return data.decode(encoding, errors="replace")


def encode(text: str) -> bytes:
    """Return the bytes of a text that `decode` returned."""
    return text.encode("latin-1") if is_binary(text) else text.encode()


def is_binary(text: str) -> bool:
    """Return whether a file that begins with this text is binary; UTF-16 contains zeros too, after its mark."""
    if text[:2] in UTF16_MARKS:
        return False
    return text.startswith(BINARY_SIGNATURES) or "\0" in text[:SIGNATURE_CHARS]


def read_file(path: Path) -> str:
    """Read the text of a file; raise `FormatError` if that fails."""
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise FormatError(f"{path}: is a folder, not a file")
        if size > MAX_FILE_BYTES:
            raise FormatError(f"{path}: {size} bytes; at most {MAX_FILE_BYTES} are read")
        text = decode(path.read_bytes())
    except OSError as error:
        raise FormatError(f"{path}: {file_error(path, error)}") from error
    if not text.strip():
        raise FormatError(f"{path}: empty file")
    return text
