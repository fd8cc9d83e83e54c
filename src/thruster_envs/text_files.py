"""Text files that people write, read with care.

>>> import tempfile
>>> from pathlib import Path
>>> path = Path(tempfile.mkdtemp()) / "mine.toml"
>>> _ = path.write_bytes("name = 'mine'".encode("utf-16"))
>>> read_text(path)  # doctest: +ELLIPSIS
Traceback (most recent call last):
ValueError: ...mine.toml: must be UTF-8 text, got UTF-16

Left out: other encodings than UTF-8; pipes and devices, which could keep a reader waiting for ever.
"""

from __future__ import annotations

import codecs
import os
import stat
from os import PathLike

LARGEST = 1_000_000
"""Bytes that a file may have unless the reader says otherwise."""

_OTHER_ENCODINGS = {
    codecs.BOM_UTF32_LE: "UTF-32",  # before UTF-16, whose mark it begins with
    codecs.BOM_UTF32_BE: "UTF-32",
    codecs.BOM_UTF16_LE: "UTF-16",
    codecs.BOM_UTF16_BE: "UTF-16",
}


def read_text(path: str | PathLike[str], *, largest: int = LARGEST) -> str:
    """The text of a UTF-8 file, with or without a byte-order mark, which is left out.

    Args:
        path: The file.
        largest: Bytes that it may have at most.

    Raises:
        ValueError: A path that is no regular file, or that cannot be read; a file that is too large, or not
            UTF-8 text: one line that begins with the file's name.
    """
    where = printable(path)
    try:
        mode = os.stat(path).st_mode
        if not stat.S_ISREG(mode):
            kind = "a folder" if stat.S_ISDIR(mode) else "a pipe, socket or device"
            raise ValueError(f"{where}: must be a regular file, got {kind}")
        with open(path, "rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise ValueError(f"{where}: cannot be read: {error.strerror or error}") from None
    if len(content) > largest:
        raise ValueError(f"{where}: must have at most {largest:,} bytes, got more")
    for mark, encoding in _OTHER_ENCODINGS.items():
        if content.startswith(mark):
            raise ValueError(f"{where}: must be UTF-8 text, got {encoding}")
    content = content.removeprefix(codecs.BOM_UTF8)
    odd = content.find(b"\0")
    if odd >= 0:
        raise ValueError(f"{where}: must be UTF-8 text, got a NUL byte in line {_line(content, odd)}")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{where}: must be UTF-8 text, got the byte 0x{content[error.start]:02x} "
            f"in line {_line(content, error.start)}"
        ) from None


def printable(path: str | PathLike[str]) -> str:
    r"""A path for the head of an error line: as it is, or quoted where a character of it cannot be printed.

    >>> printable("mine.toml"), printable("two\nlines.toml")
    ('mine.toml', "'two\\nlines.toml'")
    """
    text = os.fsdecode(path)
    return text if text.isprintable() else repr(text)


def _line(content: bytes, position: int) -> int:
    return content.count(b"\n", 0, position) + 1
