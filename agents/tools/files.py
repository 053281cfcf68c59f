"""Files that are whole or absent, whenever the program is stopped."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any


@contextmanager
def written_whole(path: Path, mode: str = "w") -> Iterator[IO[Any]]:
    """Open a file beside `path` for writing, and put it in the place of `path` once it is complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    encoding, newline = (None, None) if "b" in mode else ("utf-8", "")
    try:
        with open(unfinished, mode, encoding=encoding, newline=newline) as file:
            yield file
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write `rows`, which share their keys; a value that is not finite is left empty."""
    with written_whole(path) as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows({key: _plain(value, "") for key, value in row.items()} for row in rows)


def write_json(path: Path, value: Any) -> None:
    """Write `value` as JSON; a number that is not finite becomes null."""
    with written_whole(path) as file:
        json.dump(_plain(value, None), file, indent=2, ensure_ascii=False, allow_nan=False)
        file.write("\n")


def write_text(path: Path, text: str) -> None:
    """Write `text`."""
    with written_whole(path) as file:
        file.write(text)


def _plain(value: Any, missing: Any) -> Any:
    """`value` with `missing` in the place of each number that is not finite."""
    if isinstance(value, dict):
        return {key: _plain(item, missing) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item, missing) for item in value]
    if isinstance(value, float) and not (abs(value) < float("inf")):
        return missing
    return value
