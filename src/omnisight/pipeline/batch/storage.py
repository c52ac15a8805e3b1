"""Files by URL through fsspec: local folders, object stores, archives."""

import os
import posixpath
from collections.abc import Generator, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import fsspec
from fsspec.core import split_protocol
from fsspec.implementations.local import make_path_posix
from fsspec.registry import known_implementations

from omnisight.images.collect import IMAGE_SUFFIXES, natural_sort_key
from omnisight.images.write import write_bytes

# Subfolders of an output: what is stored of a run, and the records of its shards.
FOLDER = ".omnisight"
RECORDS_FOLDER = f"{FOLDER}/shards"

ACCESS_ADVICE = "check the name, and that the credentials of this machine and of the workers allow it"

# How file systems name the hash of a file, or else the time of its last change: S3; Google and Azure; zip; local;
# memory.
VERSION_KEYS = ("ETag", "etag", "CRC", "mtime", "created")

# Protocols of local files and folders.
LOCAL_PROTOCOLS = (None, "file", "local")

# Files that are read at the same time, of an object store that takes 20 ms for each, and in a row.
READ_THREADS, READ_COUNT = 16, 1000


def absolute_url(url: str) -> str:
    """Return a URL whose local file or folder does not depend on the working directory, of an archive, too."""
    *inner, last = url.split("::")
    protocol, path = split_protocol(last)
    return "::".join([*inner, make_path_posix(path) if protocol in LOCAL_PROTOCOLS else last])


def file_system(url: str) -> str:
    """Return what two URLs of one file system have in common: the protocol, and the archive if they are in one."""
    *inner, last = absolute_url(url).split("::")
    links = [link for link in inner if "://" in link]  # without caches, such as simplecache::s3://bucket/folder
    protocol = _storage(split_protocol((links or [last])[0])[0])
    of_archive, path = split_protocol(last)
    archive = f"{_storage(of_archive)}://{path if of_archive else Path(os.path.realpath(last)).as_posix()}"
    return "::".join([protocol, *links[1:], archive] if links else [protocol])


def _storage(protocol: str | None) -> str:
    """Return the name of the storage of a protocol, which may have several: gs and gcs, s3 and s3a, file and local."""
    name = protocol or "file"
    return str(known_implementations.get(name, {}).get("class", name))


def _filesystem(url: str) -> tuple[Any, str]:
    """Return the file system of a URL, and the path in it."""
    url = absolute_url(url)
    return _opened(url, _local_archive_version(url))


def _local_archive_version(url: str) -> tuple[int, int]:
    """Return the time of the last change (ns) and the size of a local archive, which is opened again if they change."""
    *links, last = url.split("::")
    if not links or split_protocol(last)[0] not in LOCAL_PROTOCOLS:
        return 0, 0
    try:
        found = os.stat(last)
    except OSError:  # an error of the file system names the file
        return 0, 0
    return found.st_mtime_ns, found.st_size


@cache
def _opened(url: str, version: tuple[int, int]) -> tuple[Any, str]:
    """Return the file system of a URL that is absolute, and the path in it; `version` is that of its local archive."""
    try:
        with _client_errors():
            return fsspec.core.url_to_fs(url)
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        kind = ValueError if isinstance(error, ValueError) else OSError
        raise kind(f"{url}: cannot be opened: {error}") from None


@contextmanager
def _client_errors() -> Generator[None]:
    """Raise the errors of clients of object stores and archives, which have no common class, as `OSError`."""
    try:
        yield
    except ImportError as error:
        raise ValueError(str(error)) from None
    except (OSError, ValueError):
        raise
    except Exception as error:
        raise OSError(f"{error} ({type(error).__name__})") from error


def list_images(url: str, output: str) -> dict[str, str]:
    """Return the images of a folder with its sub-folders, or of a pattern: their paths, in natural order, and versions.

    Raises
    ------
    ValueError
        If there is none, the files cannot be listed, or the output folder is among them or contains them.
    """
    among = ValueError(f"{output}: is in the folder of the images: outputs would be read as images next time")
    if is_below(output, url):
        raise among
    files, path = _filesystem(url)
    try:
        with _client_errors():
            found = _listed(files, path)
    except FileNotFoundError:
        raise ValueError(f"{url}: no such file or folder") from None
    except OSError as error:
        raise ValueError(f"{url}: cannot be listed: {error}; {ACCESS_ADVICE}") from None
    visible = [name for name in found if not posixpath.basename(name).startswith(".")]
    names = sorted((name for name in visible if name.lower().endswith(IMAGE_SUFFIXES)), key=natural_sort_key)
    if not names:
        raise ValueError(f"{url}: no images (of {len(found)} files); supported are {' '.join(IMAGE_SUFFIXES)}")
    if _is_any(output, url, {posixpath.dirname(name) for name in names}):
        raise among
    return {name: _version(found[name]) for name in names}


def _listed(files: Any, path: str) -> dict[str, Any]:
    """Return what a file system states of the files of a folder with its sub-folders, of a pattern, or of one file."""
    if "*" in path or "?" in path:
        return files.glob(path, detail=True)
    return files.find(path, detail=True) if files.isdir(path) else {path: files.info(path)}


@_client_errors()
def file_versions(url: str, paths: Sequence[str]) -> dict[str, str]:
    """Return the versions of files in the file system of a URL; those that cannot be read have none."""
    files = _filesystem(url)[0]
    return {path: _version(files.info(path)) if files.exists(path) else "" for path in paths}


def _version(info: Mapping[str, Any]) -> str:
    """Return what differs between versions of a file: its size, and its hash or else the time of its last change."""
    mark = next((info[key] for key in VERSION_KEYS if info.get(key)), "")
    return f"{info.get('size')} {mark}".replace('"', "")


def is_below(url: str, folder: str) -> bool:
    """Return whether a URL is a folder or below it."""
    path, root = (real_path(each, _filesystem(each)[1]).rstrip("/") for each in (url, folder))
    return _filesystem(url)[0] is _filesystem(folder)[0] and f"{path}/".startswith(f"{root}/")


def _is_any(output: str, source: str, folders: Iterable[str]) -> bool:
    """Return whether the output is one of some folders in the file system of the source."""
    files, path = _filesystem(output)
    real = {real_path(source, folder).rstrip("/") for folder in folders}
    return files is _filesystem(source)[0] and real_path(output, path).rstrip("/") in real


def real_path(url: str, path: str) -> str:
    """Return a path in the file system of a URL; of a local one without symbolic links."""
    return Path(os.path.realpath(path)).as_posix() if is_local(url) else path


def refuse_overwrite(output: str, names: Iterable[str], source: str, inputs: Iterable[str]) -> None:
    """Raise `ValueError` if a file below the output folder is one of the inputs in the file system of the source."""
    if _filesystem(source)[0] is not _filesystem(output)[0]:
        return
    read = {real_path(source, path) for path in inputs}
    for path in (path_below(output, name) for name in names):
        if real_path(output, path) in read:
            raise ValueError(f"{path}: is one of the inputs and would be overwritten; choose another output")


def path_below(url: str, name: str) -> str:
    """Return the path of a file below a folder in its file system."""
    return posixpath.join(_filesystem(url)[1], name)


@_client_errors()
def read_file(url: str, path: str) -> bytes:
    """Read a file of the file system of a URL."""
    return _filesystem(url)[0].cat_file(path)


@_client_errors()
def write_file(url: str, name: str, data: bytes) -> None:
    """Write a file below a folder. It has all of its bytes or does not exist: object stores guarantee the same."""
    files, path = _filesystem(url)[0], path_below(url, name)
    write = (lambda: write_bytes(Path(path), data)) if is_local(url) else (lambda: _put(files, url, path, data))
    try:
        write()
    except FileNotFoundError:  # the first file of a folder; a check before each would be a request to an object store
        files.makedirs(posixpath.dirname(path), exist_ok=True)
        write()


def _put(files: Any, url: str, path: str, data: bytes) -> None:
    """Write an object; errors of object stores do not name it."""
    try:
        files.pipe_file(path, data)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise type(error)(f"{url}: {path} cannot be written: {error}; {ACCESS_ADVICE}") from None


@_client_errors()
def remove_file(url: str, name: str) -> None:
    """Delete a file below a folder if it exists."""
    with suppress(FileNotFoundError):
        _filesystem(url)[0].rm_file(path_below(url, name))


def read_below(url: str, name: str) -> bytes | None:
    """Read a file below a folder; None if there is none."""
    try:
        return read_file(url, path_below(url, name))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise OSError(f"{url}: cannot be read: {error}; {ACCESS_ADVICE}") from None


@_client_errors()
def read_all_below(url: str, folder: str) -> list[bytes]:
    """Read the files in a folder below a folder, several at a time from an object store; none if it does not exist."""
    files, root = _filesystem(url)
    files.invalidate_cache()
    try:
        paths = sorted(files.ls(posixpath.join(root, folder), detail=False))
    except FileNotFoundError:
        return []
    return list(files.cat(paths, on_error="omit").values()) if paths else []


def read_each_below(url: str, names: Sequence[str]) -> Generator[bytes]:
    """Read files below a folder, in their order, several at a time."""
    with ThreadPoolExecutor(READ_THREADS) as pool:
        for first in range(0, len(names), READ_COUNT):
            paths = [path_below(url, name) for name in names[first : first + READ_COUNT]]
            yield from pool.map(partial(read_file, url), paths)


def is_local(url: str) -> bool:
    """Return whether files are on this machine."""
    protocol = _filesystem(url)[0].protocol
    return "file" in ((protocol,) if isinstance(protocol, str) else protocol)
