"""What the programs of this repository share: errors and Ctrl-C in one line, a look at where results go."""

from __future__ import annotations

import errno
import io
import os
import shutil
import signal
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = [
    "check_file",
    "check_folder",
    "check_memory",
    "check_space",
    "complain",
    "reason",
    "run_command",
]

_LONGEST_NAME = 255  # bytes, on the file systems of Linux


def run_command(program: str, body: Callable[[], int]) -> int:
    """Run a program: what is expected to go wrong becomes one line and a status, and a warning one line.

    Args:
        program: Its name, at the head of lines.
        body: Returns the status. An OSError of it means that the system refuses something (1), Ctrl-C 130.
    """
    if getattr(signal.getsignal(signal.SIGINT), "__name__", None) == "<lambda>":
        signal.signal(signal.SIGINT, signal.default_int_handler)  # the program's own was for its loading
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that has not all characters shows "?"
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _said_once(program)
            status = body()
        sys.stdout.flush()
    except KeyboardInterrupt:
        complain(program, "interrupted")
        status = 130
    except BrokenPipeError:  # whoever read the output has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 1
    except OSError as error:
        complain(program, reason(error))
        status = 1
    return status


def _said_once(program: str) -> Callable[..., None]:
    """What shows a warning as one line, and the same one only once."""
    said: set[str] = set()

    def show(message: Warning | str, *_: Any) -> None:
        line = str(message)
        if line not in said:
            said.add(line)
            complain(program, f"warning: {line}")

    return show


def complain(program: str, line: str) -> None:
    """Print one line on the standard error."""
    print(f"{program}: {' '.join(line.split())}", file=sys.stderr, flush=True)  # noqa: T201  # what it is for


def reason(error: Exception) -> str:
    """What an error of the system says, and of which file."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror if error.filename is None else f"{error.strerror} ({error.filename})"
    return str(error)


def check_file(option: str, path: Path) -> None:
    """Check that a file can be written, before the work whose result goes there.

    Args:
        option: Which asks for it.
        path: Of the file; its folder is made where there is none.

    Raises:
        ValueError: It cannot; one line says why.
    """
    try:
        _check_names(path)
        if os.path.lexists(path) and not stat.S_ISREG(os.stat(path).st_mode):
            what = "a folder" if path.is_dir() else "no ordinary file"
            raise ValueError(f"{option} must be a file, got {path}, which is {what}")
        target = path.resolve()  # of a link, what it points to
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not os.access(target, os.W_OK):
            raise ValueError(f"{option} cannot be written: {path} is read-only")
        _probe(target.parent)
    except (OSError, RuntimeError) as error:  # a loop of links is a RuntimeError before Python 3.13
        raise ValueError(f"{option} cannot be written: {reason(error)}") from None


def check_folder(option: str, path: Path) -> None:
    """Check that files can be made in a folder, or that the folder can be made.

    Args:
        option: Which asks for it.
        path: Of the folder; it is not made here.

    Raises:
        ValueError: They cannot; one line says why.
    """
    try:
        _check_names(path)
        there = path
        while not os.path.lexists(there) and there != there.parent:
            there = there.parent
        if not there.is_dir():
            raise ValueError(f"{option} must be a folder, got {path}: {there} is none")
        _probe(there)
    except (OSError, RuntimeError) as error:
        raise ValueError(f"{option} cannot be written to: {reason(error)}") from None


def check_space(option: str, path: Path, needed: int) -> None:
    """Check that a file system has space.

    Args:
        option: Which asks for it.
        path: Of a file or folder, which need not exist.
        needed: Bytes.

    Raises:
        ValueError: There is less.
    """
    there = path.absolute()
    while not there.exists():
        there = there.parent
    free = shutil.disk_usage(there).free
    if free < needed:
        raise ValueError(
            f"{option} needs about {needed / 1e6:.0f} MB of space, and {path} has {free / 1e6:.1f} MB left"
        )


def check_memory(option: str, value: int, needed: int) -> None:
    """Check that this machine has memory.

    Args:
        option: Which asks for it.
        value: Of the option.
        needed: Bytes.

    Raises:
        ValueError: It has less.
    """
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > there:
        raise ValueError(
            f"{option} is {value}, which needs {needed / 1e9:.1f} GB of memory; this machine has "
            f"{there / 1e9:.1f} GB: choose fewer"
        )


def _check_names(path: Path) -> None:
    long = next((part for part in path.parts if len(os.fsencode(part)) > _LONGEST_NAME), None)
    if long is not None:
        raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG), f"{long[:20]}...")


def _probe(folder: Path) -> None:
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(b"x")
        file.flush()
