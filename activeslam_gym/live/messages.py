"""What the tracker's process and the page's send each other, beside a `State` after each image."""

from dataclasses import dataclass

PAUSE, STEP, RESTART, FOLLOW, MARK, SAVE = "pause", "step", "restart", "follow", "mark", "save"
REQUESTS = {PAUSE: bool, STEP: bool, RESTART: bool, FOLLOW: bool, MARK: int, SAVE: bool}
"""Requests of the page, (name, value), with the types of their values: whether to pause; process one image; restart;
whether the simulated person follows the advice; the id of a feature to mark, or 0; save the map."""


@dataclass(frozen=True)
class About:
    """Facts about a run that the page needs at its start."""

    name: str
    """Of the source."""
    image_size: tuple[int, int]
    """Width and height [px]."""
    focal: float
    """[px]"""
    rate: float
    """Image rate of the source [Hz]."""
    room_size: tuple[float, float, float]
    """[m]"""
    person: bool
    """Whether a simulated person holds the camera, in a room of `room_size` about the origin; else it is a guess."""
    replay: bool = False
    """Whether this is the replay of a recording."""
