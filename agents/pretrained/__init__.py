"""The shipped weights, `NAME.npz`, each beside its card, `NAME.json`: how it was trained, and what it reached."""

from pathlib import Path

FOLDER = Path(__file__).parent


def names(folder: Path = FOLDER) -> list[str]:
    """Names of the learned policies in a folder."""
    return sorted(path.stem for path in folder.glob("*.npz"))
