"""The shipped weights, `NAME.npz`, each beside its card, `NAME.json`: how it was trained, and what it reached."""

from pathlib import Path

FOLDER = Path(__file__).parent


def names(folder: Path = FOLDER) -> list[str]:
    """Names of the learned policies in a folder."""
    return sorted(path.stem for path in folder.glob("[!.]*.npz"))  # not the unfinished file of a killed process


def path_of(name: str) -> Path | None:
    """The shipped weights of that name, or the file of weights (policy.npz) that it is; None where there is none."""
    path = Path(name) if name.endswith(".npz") else FOLDER / f"{name}.npz"
    return path if path.is_file() else None
