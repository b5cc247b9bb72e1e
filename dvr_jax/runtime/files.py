"""Files that are written whole or not at all, and the folders that they go to."""

import errno
import os
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Replace a file by new content in one step that cannot leave half a file behind.

    The content goes to `.NAME.PID.tmp` in the same folder, is flushed to the disk and then renamed. A process that is
    killed in the middle leaves the old file (or none) as it was, and perhaps the temporary file, at which no reader of
    this package looks.

    Args:
        path: File to write; its folder exists.
        content: Bytes of the whole file.

    Raises:
        OSError: The file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")

    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)

    # The new name is an entry of the folder, which has to reach the disk as well.
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def require_folder(folder: Path) -> None:
    """Make a folder unless it exists.

    Raises:
        OSError: The folder cannot be made or cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)

    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
