"""Files of recordings: ``.npz``, ``.parquet`` and ``.csv``, written whole or not at all, read with care.

Each has a header with everything but the numbers (:func:`thruster_envs.recordings.header_of`): in ``.npz``
the bytes of the array ``header``, in ``.parquet`` the metadata ``recording`` of the schema, whose fields have
their ``unit``, in ``.csv`` a first line that begins with ``# ``.
"""

from __future__ import annotations

import csv
import io
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thruster_envs.extras import extra
from thruster_envs.recordings import Channel, Header, Recording, header_of
from thruster_envs.text_files import printable, read_text
from thruster_envs.whole_files import write_whole

Array = NDArray[Any]

_HEADER = "header"
_EPISODE, _STEP = "episode", "step"
"""The first two columns of a table: number of the episode, from 0, and of the instant in it."""


def write(recording: Recording, path: Path, ending: str | None = None) -> None:
    """Write a file in the form of its ending, or in the form of another one.

    Raises:
        ValueError: An ending that stands for no form.
        ModuleNotFoundError: PyArrow misses, for ``.parquet``.
        OSError: The system refuses.
    """
    form = _form(path, ending)
    write_whole(path, {".npz": _npz, ".parquet": _parquet, ".csv": _csv}[form](recording))


def read(path: Path) -> Recording:
    """Read a file that :func:`write` wrote.

    Raises:
        ValueError: An ending that stands for no form; a damaged file: one line that begins with its name.
        ModuleNotFoundError: PyArrow misses, for ``.parquet``.
    """
    form: Callable[[Path], Recording] = {".npz": _from_npz, ".parquet": _from_parquet, ".csv": _from_csv}[
        _form(path, None)
    ]
    try:
        return form(path)
    except (OSError, ValueError) as error:
        unread = isinstance(error, OSError) and error.strerror
        said = f"cannot be read: {unread}" if unread else " ".join(str(error).split())
        where = printable(path)
        raise ValueError(said if said.startswith(where) else f"{where}: {said}") from None


def _form(path: Path, ending: str | None) -> str:
    form = path.suffix.lower() if ending is None else ending
    if form not in (".npz", ".parquet", ".csv"):
        raise ValueError(
            f"{printable(path)}: must end in .npz, .parquet or .csv, got {form or 'no ending'!r}"
        )
    return form


# Arrays by name --------------------------------------------------------------------------------------------


def _npz(recording: Recording) -> bytes:
    file = io.BytesIO()
    header = np.frombuffer(header_of(recording).encode(), np.uint8)
    arrays: dict[str, Any] = {f"channel {name}": array for name, array in recording.arrays.items()}
    np.savez_compressed(file, **(arrays | {_HEADER: header}))
    return file.getvalue()


def _from_npz(path: Path) -> Recording:
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as found:
            if not isinstance(found, np.lib.npyio.NpzFile) or _HEADER not in found.files:
                raise ValueError("it must be a recording, got other arrays")
            header = Header.parse(np.asarray(found[_HEADER], np.uint8).tobytes())
            arrays = {name.removeprefix("channel "): found[name] for name in found.files if name != _HEADER}
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, MemoryError, NotImplementedError) as error:
        raise ValueError(f"it is damaged ({type(error).__name__}: {error})") from None
    except AttributeError:  # of a file that holds one array
        raise ValueError("it must be a recording, got other arrays") from None
    return header.recording(arrays)


# Tables ----------------------------------------------------------------------------------------------------


def _rows_of(channel: Channel, lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of each instant the entry of a channel that stands in its row, -1 for none."""
    episodes = np.repeat(np.arange(lengths.size), lengths + 1)
    if channel.per == "episode":
        return episodes
    rows = np.arange(episodes.size)
    if channel.per == "instant":
        return rows
    last = np.cumsum(lengths + 1) - 1
    steps = rows - episodes
    steps[last] = -1
    return steps


def _columns(recording: Recording) -> Iterator[tuple[str, Channel, Array, NDArray[np.bool_]]]:
    """Name, channel, values and where there are some, of every column of the table."""
    for name, channel in recording.channels.items():
        rows = _rows_of(channel, recording.lengths)
        there = rows >= 0
        columns, array = channel.columns(name), recording.arrays[name]
        array = array.reshape(len(array), len(columns))
        padded = array if len(array) else np.zeros((1, array.shape[1]), array.dtype)
        for k, column in enumerate(columns):
            yield column, channel, padded[np.maximum(rows, 0), k], there


def _gathered(header: Header, column: Callable[[str, np.dtype[Any], NDArray[np.bool_]], Array]) -> Recording:
    """The recording whose columns a function reads: from name, type and where there are values."""
    lengths = np.array(header.lengths, np.int64)
    arrays = {}
    firsts = np.cumsum(lengths + 1) - lengths - 1
    for name, channel in header.channels.items():
        rows = _rows_of(channel, lengths)
        there = rows >= 0
        kept = firsts if channel.per == "episode" else np.flatnonzero(there)
        columns = [column(one, header.types[name], there)[kept] for one in channel.columns(name)]
        stacked = np.stack(columns, axis=-1) if columns else np.zeros((kept.size, 0), header.types[name])
        arrays[name] = stacked.reshape(kept.size, *channel.shape)
    return header.recording(arrays)


def _instants(recording: Recording) -> tuple[Array, Array]:
    """(instants,) number of the episode, and of the instant in it."""
    episodes = recording.episode
    starts = np.cumsum(recording.lengths + 1) - recording.lengths - 1
    return episodes, np.arange(episodes.size) - starts[episodes]


def _parquet(recording: Recording) -> bytes:
    with extra("recordings", "a recording as .parquet"):
        import pyarrow as pa
        from pyarrow import parquet

    episodes, steps = _instants(recording)
    fields = [pa.field(name, pa.int64(), False, {"unit": "1"}) for name in (_EPISODE, _STEP)]
    values = [pa.array(episodes), pa.array(steps)]
    for name, channel, column, there in _columns(recording):
        values.append(pa.array(column, mask=None if there.all() else ~there))
        fields.append(pa.field(name, values[-1].type, True, {"unit": channel.unit, "per": channel.per}))
    schema = pa.schema(fields, {"recording": header_of(recording)})
    file = io.BytesIO()
    parquet.write_table(pa.table(values, schema=schema), file, write_page_checksum=True)
    return file.getvalue()


def _from_parquet(path: Path) -> Recording:
    with extra("recordings", "a recording as .parquet"):
        import pyarrow as pa
        from pyarrow import parquet

    try:
        table = parquet.read_table(io.BytesIO(path.read_bytes()), page_checksum_verification=True)
    except (pa.ArrowException, MemoryError) as error:
        raise ValueError(f"it is damaged ({error})") from None
    text = (table.schema.metadata or {}).get(b"recording")
    if text is None:
        raise ValueError("it must be a recording, got another table")
    header = Header.parse(text)
    if table.num_rows != header.instants:
        raise ValueError(f"it must have {header.instants} rows, got {table.num_rows}")

    def column(name: str, kind: np.dtype[Any], there: NDArray[np.bool_]) -> Array:
        if name not in table.column_names:
            raise ValueError(f"it must have the column {name!r}, got none")
        found = table.column(name).combine_chunks()
        given = np.asarray(found.is_valid())
        if not np.array_equal(given, there):
            raise ValueError(f"the column {name!r} must have values exactly where there are steps")
        try:
            filled = found.fill_null(False if kind.kind == "b" else 0)
            return np.asarray(filled.to_numpy(zero_copy_only=False)).astype(kind, casting="equiv")
        except (pa.ArrowException, TypeError) as error:
            raise ValueError(
                f"the column {name!r} must be of type {kind}, got {found.type} ({error})"
            ) from None

    return _gathered(header, column)


def _csv(recording: Recording) -> bytes:
    episodes, steps = _instants(recording)
    names, columns = [_EPISODE, _STEP], [episodes.tolist(), steps.tolist()]
    for name, _, column, there in _columns(recording):
        if column.dtype.kind == "f":
            text = [repr(one) for one in column.tolist()] if column.itemsize == 8 else list(map(str, column))
        else:
            text = list(
                map(str, column.astype(np.int64 if column.dtype.kind in "bi" else np.uint64).tolist())
            )
        names.append(name)
        columns.append([one if here else "" for one, here in zip(text, there.tolist(), strict=True)])
    file = io.StringIO()
    file.write(f"# {header_of(recording)}\n")
    rows = csv.writer(file, lineterminator="\n")
    rows.writerow(names)
    rows.writerows(zip(*columns, strict=True))
    return file.getvalue().encode()


def _from_csv(path: Path) -> Recording:
    first, _, rest = read_text(path, largest=path.stat().st_size).partition("\n")
    if not first.startswith("# "):
        raise ValueError("it must be a recording, whose first line begins with '# ', got another text")
    header = Header.parse(first[2:])
    try:
        lines = list(csv.reader(io.StringIO(rest)))
    except csv.Error as error:
        raise ValueError(f"it is damaged ({error})") from None
    names, rows = (lines[0], lines[1:]) if lines else ([], [])
    if len(rows) != header.instants:
        raise ValueError(f"it must have {header.instants} rows, got {len(rows)}")
    for number, row in enumerate(rows, start=3):
        if len(row) != len(names):
            raise ValueError(f"line {number} must have {len(names)} entries, got {len(row)}")
    place = {name: k for k, name in enumerate(names)}

    def column(name: str, kind: np.dtype[Any], there: NDArray[np.bool_]) -> Array:
        if name not in place:
            raise ValueError(f"it must have the column {name!r}, got none")
        values = np.zeros(len(rows), kind)
        for number, (row, here) in enumerate(zip(rows, there.tolist(), strict=True)):
            text = row[place[name]]
            try:
                if not here and text:
                    raise ValueError
                if here:
                    values[number] = kind.type(float(text) if kind == np.float64 else _number(text, kind))
            except (ValueError, OverflowError):
                right = f"a number of type {kind}" if here else "empty"
                raise ValueError(f"line {number + 3}: {name} must be {right}, got {text[:40]!r}") from None
        return values

    return _gathered(header, column)


def _number(text: str, kind: np.dtype[Any]) -> Any:
    if kind.kind == "f":
        return np.dtype(kind).type(text)
    value = int(text)
    if kind.kind == "b" and value not in (0, 1):
        raise ValueError
    return value
