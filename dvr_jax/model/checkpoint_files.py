"""Checksums of the files of a checkpoint, verified before any library parses them.

`checksums.json` in a checkpoint's folder has the SHA-256 of each of its files. It is written last, so a checkpoint
without it was not completed. Checkpoints before version 0.10 have none, and do not say so in their metadata either.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from dvr_jax.runtime.files import read_whole, write_whole
from dvr_jax.runtime.json_text import parse_json

CHECKSUMS = "checksums.json"
"""Name of the file with the checksums."""

SEAL = "sealed"
"""Key in the metadata of a checkpoint that has checksums."""

ASIDE = ".damaged"
"""End of the name of a damaged checkpoint that was set aside."""


def seal_folder(folder: Path) -> None:
    """Write the checksums of all files of a folder.

    Raises:
        OSError: A file cannot be read or written.
    """
    text = json.dumps({"files": _checksums(folder)}, indent=1, sort_keys=True)
    write_whole(folder / CHECKSUMS, text.encode() + b"\n")


def damage_of(folder: Path, metadata: Path) -> str | None:
    """Say what is wrong with the files of a checkpoint.

    Args:
        folder: Folder of the checkpoint.
        metadata: Its file of metadata, which says whether there are checksums.

    Returns:
        What is wrong, or None if nothing is, or if it has no checksums to tell.
    """
    try:
        if not (folder / CHECKSUMS).exists():
            is_sealed = parse_json(read_whole(metadata)).get(SEAL, False)
            return "it was not completed" if is_sealed else None

        known = parse_json(read_whole(folder / CHECKSUMS))["files"]
        found = _checksums(folder)
        for name in sorted({*known, *found}):
            if known.get(name) != found.get(name):
                return f"the file {name} is not as it was written"
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        return f"its files cannot be read: {error}"
    return None


def set_aside(folder: Path) -> Path:
    """Rename a damaged checkpoint, so that its step can be written again; return its new place."""
    place = folder.with_name(folder.name + ASIDE)
    number = 1
    while place.exists():
        number += 1
        place = folder.with_name(f"{folder.name}{ASIDE}-{number}")

    return folder.rename(place)


def _checksums(folder: Path) -> dict[str, str]:
    """Return the checksum of each file below a folder, by its path there."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(read_whole(path)).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path != folder / CHECKSUMS
    }
