"""Files that are whole or absent, whenever the program is stopped and whatever damages them."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path to write to beside ``path``, whose folder is made; when the block is over, that file becomes ``path``.

    Where the block fails, what was at ``path`` stays and the unfinished file is removed.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    unfinished = target.with_name(f".{os.getpid()}.{target.name}")  # ends alike: some writers go by the suffix
    try:
        yield unfinished
        unfinished.replace(target)
    finally:
        unfinished.unlink(missing_ok=True)


def write_sealed(path: Path, data: bytes) -> None:
    """Write ``data`` behind its SHA-256 digest, whole or not at all, for `read_sealed`."""
    with written_whole(path) as unfinished:
        unfinished.write_bytes(_sealed(data))


def read_sealed(path: Path) -> bytes | None:
    """The data that `write_sealed` wrote to ``path``; None where the file is absent, unreadable or damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    data = content[hashlib.sha256().digest_size :]
    return data if content == _sealed(data) else None


def _sealed(data: bytes) -> bytes:
    return hashlib.sha256(data).digest() + data


def demand_writable(folder: Path) -> None:
    """Demand that ``folder`` can be written to, or made where it is absent; it is not made.

    Raises:
        OSError: it cannot.
    """
    try:
        nearest = next(path for path in (folder, *folder.resolve().parents) if path.exists())
        with TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise OSError(f"{str(folder)!r} is no folder to write to ({error.strerror})") from error
