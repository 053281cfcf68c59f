"""Files: whole or absent, growing by lines, and texts of bounded length."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path to write to beside ``path``, whose folder is made; when the block is over, that file becomes ``path``, or
    the target of that link.

    Where the block fails, what was at ``path`` stays and the unfinished file is removed.

    Raises:
        OSError: a folder, a pipe or a device is there, or it cannot be written to.
    """
    target = Path(path).resolve()
    if target.exists() and not target.is_file():
        raise OSError(f"{str(path)!r} is no regular file")
    target.parent.mkdir(parents=True, exist_ok=True)
    unfinished = target.with_name(f".{os.getpid()}.{target.name}")  # ends alike: some writers go by the suffix
    try:
        yield unfinished
        unfinished.replace(target)
    finally:
        unfinished.unlink(missing_ok=True)


@contextmanager
def argument(name: str, wrong: type[ValueError] = ValueError) -> Iterator[None]:
    """What is ``wrong``, or a file that cannot be used, in this block is reported as the argument ``name``'s.

    Raises:
        ValueError, OSError: as the block does; the message begins with the argument.
    """
    try:
        yield
    except wrong as error:
        raise type(error)(f"--{name}: {error}") from None
    except OSError as error:
        raise OSError(f"--{name}: {f'{error.filename}: {error.strerror}' if error.errno else error}") from None


class Lines:
    """A text file that grows: what is written is on the disk at once, whole or not at all.

    Raises:
        OSError: it cannot be written to.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("wb", buffering=0)

    def write(self, text: str) -> None:
        """Append the ``text``, whole lines.

        Raises:
            OSError: the disk is full, or gone; the message names the file.
        """
        begin, rest = self._file.tell(), text.encode()
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._file.truncate(begin)
            raise OSError(f"{self._path} cannot be written ({error.strerror})") from error

    def close(self) -> None:
        """Nothing more is written."""
        self._file.close()


def text_of(path: str | os.PathLike[str], most: int = 2**20) -> str:
    """The text in a file of at most ``most`` characters, without a byte order mark; no more is read.

    Raises:
        OSError: it cannot be read.
        ValueError: it is longer, or is not in UTF-8.
    """
    with open(path, encoding="utf-8-sig") as file:
        try:
            text = file.read(most + 1)
        except UnicodeDecodeError:
            raise ValueError(f"{path} must be text in UTF-8, and is not") from None
    if len(text) > most:
        raise ValueError(f"{path} must have at most {most} characters, and has more")
    return text


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


def demand_writable_file(path: Path) -> None:
    """Demand that a file can be written to ``path``; nothing is written.

    Raises:
        OSError: its folder cannot be written to.
        ValueError: it is a folder, a pipe or a device.
    """
    demand_writable((path.resolve() if path.is_symlink() else path).parent)
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is a folder, a pipe or a device; allowed: a file")
