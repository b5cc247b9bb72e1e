"""Files that are written whole or not at all, the folders that they go to, and files that others have written."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from dvr_jax.runtime.interruption import forget_temporary, remember_temporary

LARGEST_FILE = 1 << 31
"""Bytes of the largest file that is read into memory as a whole."""

OPEN_DESCRIPTORS = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")
"""Beginnings of names of pipes that a shell has opened, which are read as files are."""

_LONGEST_STEM = 60
"""Characters of a file's name that its temporary file's name has as well."""


def read_whole(path: str | Path, most: int = LARGEST_FILE) -> bytes:
    """Read a file that anybody may have put there, so it may be endless, or a pipe that nobody ever writes to.

    Args:
        path: Regular file, or a pipe that a shell has opened, as in `/dev/stdin`.
        most: Largest number of bytes.

    Returns:
        Its content.

    Raises:
        OSError: The file is missing, unreadable, of another kind or too large; the error names it.
    """
    name = os.fspath(path)
    with _naming(name):
        # Opened so, a pipe without a writer does not wait for one.
        descriptor = os.open(name, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            _require_readable(descriptor, name, most)
            os.set_blocking(descriptor, True)
            with open(descriptor, "rb", closefd=False) as file:
                content = file.read(most + 1)
        finally:
            os.close(descriptor)

    if len(content) > most:
        raise _too_large(name, most)
    return content


def write_whole(path: Path, content: bytes) -> None:
    """Replace a file by new content in one step that cannot leave half a file behind.

    The content goes to `.NAME.PID.tmp` in the same folder, is flushed to the disk and then renamed. A process that is
    killed in the middle leaves the old file (or none) as it was, and perhaps the temporary file, at which no reader of
    this package looks. What is no regular file, such as `/dev/stdout`, is written to and not replaced.

    Args:
        path: File to write; its folder exists. Where it is a link, the file that it leads to is replaced.
        content: Bytes of the whole file.

    Raises:
        OSError: The file cannot be written; the error names it.
    """
    with _naming(os.fspath(path)):
        target = Path(os.path.realpath(path))
        if target.exists() and not target.is_file() and not target.is_dir():
            target.write_bytes(content)
            return

        temporary = _write_temporary(target, content)
        try:
            os.replace(temporary, target)
        finally:
            _remove_temporary(temporary)

    _flush_folder(target.parent)


def append_line(path: Path, line: str) -> None:
    """Append a line to a file, or leave the file as it was where there is no room.

    Args:
        path: The file.
        line: The line with its end.

    Raises:
        OSError: The line cannot be written; the error names the file.
    """
    with _naming(os.fspath(path)), path.open("ab", buffering=0) as file:
        size = file.seek(0, os.SEEK_END)
        content = line.encode()
        try:
            written = file.write(content)
            if written != len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            file.truncate(size)
            raise


def write_together(
    folder: Path, contents: Mapping[str, bytes], last: str, stale: Sequence[str] = ()
) -> None:
    """Replace files of a folder that belong together, of which the last one says that all are there.

    All new content is on the disk before the first old file goes. So a disk that is full leaves the old files, and a
    process that is killed leaves the old files or ones without the last one.

    Args:
        folder: Folder of the files; it exists.
        contents: Content of each file by its name.
        last: Name of the file that goes first and comes last.
        stale: Names of files that are removed unless they have new content.

    Raises:
        OSError: A file cannot be written; the error names it.
    """
    temporary: dict[str, Path] = {}
    try:
        for name, content in contents.items():
            with _naming(str(folder / name)):
                temporary[name] = _write_temporary(folder / name, content)

        for name in (last, *(name for name in stale if name not in contents)):
            (folder / name).unlink(missing_ok=True)
        for name in sorted(contents, key=lambda name: name == last):
            with _naming(str(folder / name)):
                os.replace(temporary[name], folder / name)
    finally:
        for path in temporary.values():
            _remove_temporary(path)

    _flush_folder(folder)


def require_folder(folder: Path) -> None:
    """Make a folder unless it exists, and write and remove a file in it: a full disk is found out before the work.

    Raises:
        OSError: The folder cannot be made or cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)

    with _naming(str(folder)):
        _remove_temporary(_write_temporary(folder / "probe", bytes(1 << 14)))


def require_writable(path: Path) -> None:
    """Make the folder of a file that will be written, and refuse a place at which no file can be written.

    Raises:
        OSError: The file's folder cannot be made or written to, or a folder has the file's name.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        return

    require_folder(Path(os.path.realpath(path)).parent)


@contextmanager
def _naming(name: str) -> Iterator[None]:
    """Give errors of the operating system the name of the file that the caller knows."""
    try:
        yield
    except OSError as error:
        # Errors of an open file, such as that of a full disk, have no name, and others that of a temporary file.
        if error.filename is None or str(error.filename).endswith(".tmp"):
            error.filename = name
        error.filename2 = None
        raise


def _require_readable(descriptor: int, name: str, most: int) -> None:
    """Refuse folders, devices, pipes that nobody writes to, and files that are too large."""
    status = os.fstat(descriptor)
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), name)

    is_open_pipe = stat.S_ISFIFO(status.st_mode) and name.startswith(OPEN_DESCRIPTORS)
    if not stat.S_ISREG(status.st_mode) and not is_open_pipe:
        raise OSError(errno.EINVAL, "it is no regular file", name)
    if status.st_size > most:
        raise _too_large(name, most)


def _too_large(name: str, most: int) -> OSError:
    return OSError(errno.EFBIG, f"it is larger than {most:,} bytes", name)


def _write_temporary(target: Path, content: bytes) -> Path:
    """Write the temporary file beside a file, flushed to the disk, and return its path."""
    temporary = target.with_name(f".{target.name[:_LONGEST_STEM]}.{os.getpid()}.tmp")
    remember_temporary(str(temporary))

    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        _remove_temporary(temporary)
        raise
    return temporary


def _remove_temporary(temporary: Path) -> None:
    """Remove a temporary file, if it is still there."""
    with suppress(OSError):
        temporary.unlink(missing_ok=True)
    forget_temporary(str(temporary))


def _flush_folder(folder: Path) -> None:
    """Flush a folder to the disk: a new name is an entry of the folder. Not every file system can do that."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
