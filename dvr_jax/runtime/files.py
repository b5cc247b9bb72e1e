"""Files that are written whole or not at all, and the folders that they go to."""

import errno
import os
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Replace the file by this content: who is killed in the middle leaves the old file, or none, as it was.

    The content goes to `.NAME.PID.tmp` in the same folder, is flushed to the disk and then renamed. A killed process
    leaves that temporary file behind; no reader of this package looks at it.
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
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # the new name is on the disk as well
    finally:
        os.close(folder)


def require_folder(folder: Path) -> None:
    """Make a folder unless it is there.

    Raises:
        OSError: it cannot be made, or not be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
