"""Results as CSV, JSON and text, each written whole or not at all."""

import csv
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from activeslam_gym.files import demand_writable, demand_writable_file, written_whole


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write `rows`, which share their keys; a value that is not finite is left empty."""
    with written_whole(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(_finite(list(rows)))  # None is written as nothing


def write_json(path: Path, value: Any) -> None:
    """Write `value` as JSON; a number that is not finite becomes null."""
    write_text(path, json_text(value))


def json_text(value: Any) -> str:
    """`value` as JSON; a number that is not finite becomes null, a path its text. A list of numbers is one line."""
    text = json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False, default=os.fspath)
    return re.sub(r"\[\n[-+.\w\s,]+\]", lambda numbers: "[" + " ".join(numbers[0][1:-1].split()) + "]", text) + "\n"


def write_text(path: Path, text: str) -> None:
    """Write `text`, its line ends as they are."""
    with written_whole(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8", newline="")


def writable_folder(argument: str, path: Path, demand: Callable[[Path], None] = demand_writable) -> None:
    """Raise ValueError, which names the argument, where the folder cannot be made or written into; it is not made."""
    try:
        demand(path)
    except (OSError, ValueError) as error:
        raise ValueError(f"{argument}: {error}") from error


def writable_file(argument: str, path: Path) -> None:
    """The same for a file, which may be absent."""
    writable_folder(argument, path, demand_writable_file)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Make `folder` and lock it against other processes, where the system has such locks, until the block ends.

    Raises ValueError where another process holds the lock.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        import fcntl
    except ImportError:  # not a Unix
        yield
        return
    held = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError as error:
        raise ValueError(f"out: another process writes into {str(folder)!r}; allowed: another folder") from error
    finally:
        os.close(held)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn every error of reading a damaged or foreign file into a ValueError of one line."""
    try:
        yield
    except Exception as error:  # readers of archives, arrays and tensors raise a dozen kinds
        kind = "" if type(error) is ValueError else f"{type(error).__name__}: "
        raise ValueError(f"{str(path)!r} cannot be read: {kind}{next(iter(str(error).splitlines()), '')}") from error


def _finite(value: Any) -> Any:
    """`value` with None in the place of each number that is not finite."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
