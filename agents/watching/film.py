"""Pictures of episodes, side by side, as an animation."""

from collections.abc import Sequence
from copy import deepcopy
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from activeslam_gym import rendering
from activeslam_gym.envs.snapshot import Snapshot
from activeslam_gym.files import written_whole
from activeslam_gym.rendering.scene import TEXT
from activeslam_gym.vision.film import video_to

SUFFIXES = (".gif", ".webp", ".png", ".mp4")  # animations, which Pillow writes, and a video
COLOURS = 64  # of the palette; the pictures are flat
STRIP_PX = 26  # height of the strip with a name
LOST = "#D62728"
"""Colour of the word on a lost episode."""

Picture = np.ndarray  # (H, W, 3) uint8


class Film:
    """A moment of an environment every `every` seconds of its time, and their pictures, `width` pixels wide."""

    def __init__(self, every: float, width: int) -> None:
        self.every = every
        self.size = (width, round(width * rendering.REFERENCE_SIZE[1] / rendering.REFERENCE_SIZE[0]))
        self._moments: list[tuple[Snapshot, bool]] = []  # and whether it is lost then

    def observe(self, core: Any, info: dict[str, Any]) -> None:
        """Keep the moment if it is time for one, or the episode is lost, which stands under the time."""
        if core.time >= self.every * len(self._moments) - 1e-9 or info["lost"]:
            self._moments.append((deepcopy(core.snapshot()), info["lost"]))

    @property
    def curve(self) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] and entropies [bit] up to the last moment."""
        last = self._moments[-1][0]
        return last.times, last.entropy

    def pictures(self, beside: Sequence[tuple[np.ndarray, np.ndarray]] = ()) -> list[Picture]:
        """The moments as pictures, with the entropies of the films ``beside`` in each (their `curve`)."""
        drawn = ((rendering.draw(moment, self.size, beside), lost) for moment, lost in self._moments)
        return [written(one, 0.08 * len(one), "lost", LOST) if lost else one for one, lost in drawn]


def written(picture: Picture, top: float, words: str, colour: str) -> Picture:
    """A copy with these words at its left margin."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(picture)
    font = ImageFont.load_default(18)
    ImageDraw.Draw(image).text((0.022 * image.width, round(top)), words, fill=colour, font=font)
    return np.asarray(image)


def side_by_side(films: Sequence[Sequence[Picture]], names: Sequence[str]) -> list[Picture]:
    """The films beside each other under their names; a shorter one stands still at its end."""
    blanks = [np.full((STRIP_PX, film[0].shape[1], 3), 255, np.uint8) for film in films]
    strips = [written(blank, 4, name, TEXT) for blank, name in zip(blanks, names, strict=True)]
    last = [film[-1] for film in films]
    pictures = ([end if one is None else one for one, end in zip(moment, last)] for moment in zip_longest(*films))
    return [np.hstack([np.vstack(pair) for pair in zip(strips, beside)]) for beside in pictures]


def write_animation(path: Path, pictures: Sequence[Picture], seconds: float) -> None:
    """Write the pictures, each shown for so many seconds and the last for two; an animation over and over; whole or
    not at all."""
    if path.suffix == ".mp4":
        with video_to(path, 1.0 / seconds) as add:
            for picture in [*pictures, *[pictures[-1]] * round(2.0 / seconds)]:
                add(picture)
        return
    from PIL import Image

    images = [Image.fromarray(picture) for picture in pictures]
    palette = images[-1].quantize(COLOURS, Image.Quantize.FASTOCTREE)  # the fullest picture has every colour
    if path.suffix == ".gif":
        images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [round(1000 * seconds)] * (len(images) - 1) + [2000]
    how: dict[str, Any] = {"format": path.suffix[1:].upper(), "duration": durations, "loop": 0, "optimize": True}
    with written_whole(path) as unfinished:
        images[0].save(unfinished, save_all=True, append_images=images[1:], **how)
