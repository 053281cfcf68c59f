"""Results as CSV, JSON and text, each whole or not at all."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from activeslam_gym.files import written_whole


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write `rows`, which share their keys; a value that is not finite is left empty."""
    with written_whole(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows({key: _plain(value, "") for key, value in row.items()} for row in rows)


def write_json(path: Path, value: Any) -> None:
    """Write `value` as JSON; a number that is not finite becomes null."""
    write_text(path, json.dumps(_plain(value, None), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write `text`, its line ends as they are."""
    with written_whole(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8", newline="")


def written(folder: Path) -> list[str]:
    """Names of the results in `folder`."""
    return sorted(path.name for path in folder.iterdir() if path.is_file())


def _plain(value: Any, missing: Any) -> Any:
    """`value` with `missing` in the place of each number that is not finite."""
    if isinstance(value, dict):
        return {key: _plain(item, missing) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item, missing) for item in value]
    if isinstance(value, float) and not (abs(value) < float("inf")):
        return missing
    return value
