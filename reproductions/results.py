"""What came of running reproductions, kept as JSON and shown as a page that is made from the JSON alone."""

from __future__ import annotations

import json
import os
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from reproductions.figures import look, save
from reproductions.record import Effort, Finding, Reproduction
from reproductions.registry import fingerprint, order
from thruster_envs.text_files import printable, read_text

__all__ = ["FIGURES", "Entry", "entry_of", "merge", "read", "render"]

Entry: TypeAlias = dict[str, Any]
"""What the JSON holds for one id."""

DATA = "reproductions.json"
PAGE = "reproductions.md"
FIGURES = "reproductions"

_LARGEST = 100_000_000  # bytes of the data


def entry_of(reproduction: Reproduction, effort: Effort, folder: Path | None) -> Entry:
    """Run a reproduction.

    Args:
        reproduction: That is run.
        effort: What it may cost.
        folder: Of the page; the figure goes below it. None to draw nothing.
    """
    finding = reproduction.run(effort)
    said = {key: value for key, value in vars(reproduction).items() if key not in ("run", "alone")}
    entry: Entry = said | {
        "ours": finding.ours,
        "verdict": finding.verdict.value,
        "reason": finding.reason,
        "checks": plain(finding.checks),
        "note": finding.note,
        "tables": [asdict(table) for table in finding.tables],
        "figure": None if folder is None else _drawn(reproduction.id, finding, folder),
        "data": plain(finding.data),
        "effort": asdict(effort),
        "fingerprint": fingerprint(reproduction, effort),
    }
    clean: Entry = json.loads(json.dumps(entry, allow_nan=False))  # what a reader of the file will see
    return clean


def _drawn(name: str, finding: Finding, folder: Path) -> str | None:
    if finding.figure is None:
        return None
    path = folder / FIGURES / f"{name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    with look():
        save(finding.figure(), path)
    return path.relative_to(folder).as_posix()


def plain(value: Any) -> Any:
    """A value with NumPy's numbers and arrays, tuples and mappings turned into what JSON knows.

    >>> plain({"rates": np.array([0.5, 1.0]), 3: (np.int64(2), True)})
    {'rates': [0.5, 1.0], '3': [2, True]}
    """
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, tuple | list):
        return [plain(one) for one in value]
    if hasattr(value, "items"):
        return {str(key): plain(one) for key, one in value.items()}
    return value


def read(folder: Path) -> dict[str, Entry]:
    """The entries in a folder, by id; none if nothing was written there yet.

    Raises:
        ValueError: A file that is damaged, or not of this program: one line that begins with its name.
    """
    path = folder / DATA
    if not path.exists():
        return {}
    text = read_text(path, largest=_LARGEST)
    try:
        kept = json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "nested too deep" if isinstance(error, RecursionError) else error
        raise ValueError(f"{printable(path)}: not JSON: {reason}") from None
    if not isinstance(kept, dict) or not all(map(_is_entry, kept.values())):
        raise ValueError(
            f"{printable(path)}: must be results as `python -m reproductions run` writes them; "
            "move the file away, or give another --output"
        )
    return kept


def _is_entry(value: Any) -> bool:
    texts = ("id", "title", "source", "lines", "reported", "criterion", "ours", "verdict", "fingerprint")
    return (
        isinstance(value, dict)
        and all(isinstance(value.get(name), str) for name in texts)
        and all(name in value for name in ("reason", "note", "figure", "data"))
        and isinstance(value.get("checks"), dict)
        and isinstance(value.get("tables"), list)
        and isinstance(value.get("effort"), dict)
    )


def merge(entries: list[Entry], folder: Path) -> None:
    """Put entries in the place of those with the same ids, and render the page anew."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = read(folder) | {entry["id"]: entry for entry in entries}
    kept = {name: kept[name] for name in sorted(kept, key=order)}
    _replace(folder / DATA, json.dumps(kept, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    _replace(folder / PAGE, render(kept))


def _replace(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    unfinished = path.with_name(f"{path.name}.{os.getpid()}")
    unfinished.write_text(text, encoding="utf-8")
    unfinished.replace(path)


def render(entries: dict[str, Entry]) -> str:
    """The page."""
    counts = Counter(entry["verdict"] for entry in entries.values())
    parts = [
        "# Reproductions\n",
        "Written by `python -m reproductions run all`; not edited by hand. Every table and figure of the "
        "sources, recomputed. A verdict follows from the checks that are listed under each id.\n",
        f"{len(entries)} results: {', '.join(f'{count} {one}' for one, count in sorted(counts.items()))}.\n",
    ]
    for source in dict.fromkeys(entry["source"] for entry in entries.values()):
        of_source = [entry for entry in entries.values() if entry["source"] == source]
        parts.append(f"## {source}\n")
        head = ("id", "what", "source lines", "reported", "ours", "criterion", "verdict")
        parts.append(_table(head, [_line(entry) for entry in of_source]))
        parts += [_section(entry) for entry in of_source]
    return "\n".join(parts)


def _line(entry: Entry) -> tuple[str, ...]:
    name = entry["id"]
    verdict = f"**{entry['verdict']}**" + (f": {entry['reason']}" if entry["reason"] else "")
    link = f"[{name}](#{name.lower()})"
    return (
        link, entry["title"], entry["lines"], entry["reported"], entry["ours"], entry["criterion"], verdict,
    )  # fmt: skip


def _section(entry: Entry) -> str:
    name = entry["id"]
    verdict = entry["verdict"] + (f": {entry['reason']}" if entry["reason"] else "")
    parts = [
        f'### <a id="{name.lower()}"></a>{name}: {entry["title"]}\n',
        f"`python -m reproductions run {name}`. Verdict: **{verdict}**.\n",
    ]
    if entry["note"]:
        parts.append(f"{entry['note']}\n")
    marks = {True: "holds", False: "**fails**"}
    parts.append("".join(f"- {marks[holds]}: {part}\n" for part, holds in entry["checks"].items()))
    for table in entry["tables"]:
        parts.append(f"{table['title']}\n")
        parts.append(_table(table["head"], table["rows"]))
    if entry["figure"]:
        parts.append(f"![{entry['title']}]({entry['figure']})\n")
    return "\n".join(parts)


def _table(head: tuple[str, ...] | list[str], rows: list[Any]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(
        "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in line) + " |\n"
        for line in lines
    )
