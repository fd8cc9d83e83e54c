"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

_UNFINISHED = ".unfinished"


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: beside it, under a name of this process, then put in its place.

    Raises:
        OSError: The system refuses; what was there before is still there.
    """
    unfinished = path.with_name(f".{os.getpid()}-{secrets.token_hex(4)}{_UNFINISHED}")
    try:
        with unfinished.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
    handle = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(handle)  # the new name outlives a loss of power too
    finally:
        os.close(handle)


def remove_unfinished(folder: Path) -> None:
    """Remove what killed processes left of `write_whole`; for the one process that uses the folder."""
    for path in folder.glob(f".*{_UNFINISHED}"):
        path.unlink(missing_ok=True)
