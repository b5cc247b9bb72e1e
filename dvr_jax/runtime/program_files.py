"""The files of compiled programs: where they are, whom they are accepted from, and how damage is noticed.

Reading such a file runs what it holds. So it is read only where nobody but this user (and the superuser) could have
written it, and only if it has the checksum that it was written with. Whatever is wrong with the cache, programs are
compiled anew: a cache that cannot be used is no error.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
from contextlib import suppress
from pathlib import Path

from dvr_jax.runtime.files import read_whole, write_whole

SWITCH = "DVR_JAX_CACHE"
"""Environment variable: a folder for compiled programs in place of the default one, or "off"."""

KEPT = 8
"""Number of folders of executables that are kept, each for one state of the sources and the machine."""

PREFIX = "programs-"
"""Beginning of the name of each folder of executables."""

HEADER = b"dvr_jax program 1\n"
"""Beginning of each file; the SHA-256 of the file's name and of all that follows comes next."""

_DIGEST_BYTES = 32


def cache_folder() -> Path | None:
    """Return the folder for compiled programs, or None if they are not kept.

    The folder is `$DVR_JAX_CACHE` if that is set ("off" means None), else `$XDG_CACHE_HOME/dvr_jax`, else
    `~/.cache/dvr_jax`. Without a home, there is none.
    """
    chosen = os.environ.get(SWITCH)
    if chosen:
        return None if chosen == "off" else Path(chosen).absolute()

    caches = os.environ.get("XDG_CACHE_HOME")
    if not caches and os.environ.get("HOME") != "":
        caches = os.path.expanduser("~/.cache")
    # Without a home the tilde stays; the folder would then depend on where the process runs.
    return Path(caches) / "dvr_jax" if caches and os.path.isabs(caches) else None


def read_entry(path: Path) -> bytes | None:
    """Return the content of an executable's file, or None if it is absent, damaged, or could be another user's."""
    try:
        if not is_private(path):
            return None
        text = read_whole(path)
    except OSError:
        return None

    start = len(HEADER) + _DIGEST_BYTES
    content = text[start:]
    return content if text[:start] == HEADER + _digest(path.name, content) else None


def write_entry(path: Path, content: bytes) -> None:
    """Write an executable whole or not at all; a cache that cannot be written to is no error.

    Several processes may write the same file at the same time: each writes a file of its own and renames it.

    Args:
        path: File `CACHE/FOLDER/NAME`; missing folders are made, for this user alone.
        content: What `read_entry` shall return.
    """
    with suppress(OSError):
        make_folder(path.parent)
        if is_private(path.parent):
            write_whole(path, HEADER + _digest(path.name, content) + content)


def make_folder(folder: Path) -> None:
    """Make a folder of executables for this user alone, if it is missing; then remove the oldest ones beside it."""
    with suppress(OSError):
        if not folder.is_dir():
            folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
            _remove_oldest(folder.parent)


def is_private(path: Path) -> bool:
    """Return whether nobody but this user and the superuser can change a file or put another in its place.

    Raises:
        OSError: There is no such file.
    """
    whole = Path(os.path.realpath(path))
    first = whole.stat()
    if _is_foreign(first) or _others_may_write(first):
        return False

    for folder in whole.parents:
        status = folder.stat()
        # In a folder with the sticky bit, such as /tmp, nobody can rename what belongs to others.
        may_rename = _others_may_write(status) and not status.st_mode & stat.S_ISVTX
        if _is_foreign(status) or may_rename:
            return False
    return True


def _digest(name: str, content: bytes) -> bytes:
    """Return the checksum of a file's name and content, so that no program is taken for another one."""
    return hashlib.sha256(name.encode() + b"\n" + content).digest()


def _is_foreign(status: os.stat_result) -> bool:
    """Return whether a file belongs to another user than this one and the superuser."""
    return status.st_uid not in (0, os.getuid())


def _others_may_write(status: os.stat_result) -> bool:
    """Return whether others may write a file; a group of the user's own, with the user's number, is not others."""
    own_group = status.st_gid == os.getgid() == os.getuid()
    writers = stat.S_IWOTH if own_group else stat.S_IWOTH | stat.S_IWGRP
    return bool(status.st_mode & writers)


def _remove_oldest(cache: Path) -> None:
    """Remove all folders of executables but the `KEPT` ones that were written last."""
    ages: list[tuple[float, Path]] = []
    for path in cache.iterdir():
        # Another process may have removed it meanwhile.
        with suppress(OSError):
            if path.is_dir() and path.name.startswith(PREFIX):
                ages.append((path.stat().st_mtime, path))

    for _, folder in sorted(ages)[:-KEPT]:
        shutil.rmtree(folder, ignore_errors=True)
