"""`python -m agents watch`: an episode of one policy, or of several side by side."""

import json
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from activeslam_gym.envs.snapshot import Snapshot
from activeslam_gym.evaluation import Observer, row_of
from activeslam_gym.files import written_whole
from activeslam_gym.rendering.picture import REFERENCE_SIZE, NoScreen, draw
from activeslam_gym.rendering.scene import TEXT
from agents.task import Task, check, file_name, make_environment, run_policy
from agents.tools.arguments import SEEDS, Times, given, within
from agents.tools.files import writable_file, writable_folder

SPEED = 4.0  # times faster than life
COLOURS = 64  # of the palette; the pictures are flat
STRIP_PX = 26  # height of the strip with a name
LOST = "#D62728"
"""Colour of the word on a lost episode."""
Picture = np.ndarray  # (H, W, 3) uint8


@dataclass(frozen=True, kw_only=True)
class Args(Times):
    """Watch an episode in a window or, with --save or --tum, in files."""

    policies: tuple[str, ...] = ("mi-fisher",)
    """Policies: names, weight files (.npz), models of Stable-Baselines3 (.zip) or 'package.module:policy'."""
    seed: int = 1_000_000
    """Seed of the episode."""
    scenario: str = "paper"
    """Scenario: a name, fields as JSON, a file of such JSON or 'package.module:name'."""
    save: Path | None = None
    """File for an animation of all policies side by side: NAME.gif."""
    every: float = 0.5
    """Seconds of the episode between two pictures of the animation, which plays four times faster than life."""
    width: int = 640
    """Width in pixels of each policy's picture, which is two thirds as high."""
    tum: Path | None = None
    """Folder for the true and the estimated trajectories in TUM's format."""

    def __post_init__(self) -> None:
        given(self, "policies")
        within(self, seed=SEEDS, width=(64, 4096), every=(0.01, 100.0))
        if self.save is not None:
            if self.save.suffix != ".gif":
                raise ValueError(f"save must end in .gif, got {str(self.save)!r}")
            writable_file("save", self.save)
        if self.tum:
            writable_folder("tum", self.tum)


def main(args: Args) -> int:
    """Play each policy's episode, in a window where nothing is to be written; the exit status.

    Raises:
        ValueError: an unknown policy, or a bad argument of the environment.
        ImportError, gymnasium.error.Error: a package that draws, or a screen, is missing.
    """
    films, arguments = {}, args.environment(args.scenario)
    check(Task(name, args.seed, json.dumps(arguments)) for name in args.policies)
    mode = "rgb_array" if args.save or args.tum else "human"  # the former keeps the history that a picture shows
    for name, title in titles(args.policies).items():
        film, env = Film(args.every, args.width), make_environment(arguments | {"render_mode": mode})
        observers: list[Observer] = [film.observe] if args.save else []
        try:
            (episode,) = run_policy(name, env, [args.seed], observers=[observers])
        except NoScreen as error:
            message = "no screen was found to watch on; --save clip.gif or --tum write files instead"
            raise gym.error.Error(message) from error
        row = row_of(episode)
        end = "lost" if episode.lost else f"{row['bits']:.0f} bits of entropy reduction"
        print(
            f"{title}, episode {args.seed}: {end} (log score gain {row['log_score_gain']:.0f} bits), "
            f"{row['landmarks_mapped']} landmarks mapped, camera {100 * row['position_error']:.1f} cm off"
        )
        for path in episode.write_trajectories(args.tum, f"{title}-{args.seed}") if args.tum else ():
            print(f"Written to {path}")
        films[title] = film
    if args.save:
        curves = [film.curve for film in films.values()] if len(films) > 1 else []
        pictures = side_by_side([film.pictures(curves) for film in films.values()], list(films))
        write_animation(args.save, pictures, max((film.times for film in films.values()), key=len))
        print(f"Written to {args.save}")
    return 0


def titles(names: Sequence[str]) -> dict[str, str]:
    """Each policy's name once, and its title: the stem of its file, its function, or `file_name` where these are the
    same."""
    short = {name: Path(name.rpartition(":")[2]).stem for name in names}
    return {name: one if list(short.values()).count(one) == 1 else file_name(name) for name, one in short.items()}


class Film:
    """A moment of an environment every `every` seconds of its time, and their pictures, `width` pixels wide."""

    def __init__(self, every: float, width: int) -> None:
        self.every = every
        self.size = (width, round(width * REFERENCE_SIZE[1] / REFERENCE_SIZE[0]))
        self._moments: list[tuple[Snapshot, bool]] = []  # and whether it is lost, which stands under the time

    def observe(self, core: Any, info: dict[str, Any]) -> None:
        """Keep the moment if it is time for one."""
        if core.time >= self.every * len(self._moments) - 1e-9:
            self._moments.append((deepcopy(core.snapshot()), info["lost"]))

    @property
    def times(self) -> list[float]:
        """Time of each moment [s]."""
        return [float(moment.time) for moment, _ in self._moments]

    @property
    def curve(self) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] and entropies [bit] up to the last moment."""
        last = self._moments[-1][0]
        return last.times, last.entropy

    def pictures(self, beside: Sequence[tuple[np.ndarray, np.ndarray]] = ()) -> list[Picture]:
        """The moments as pictures, with the entropies of the films ``beside`` in each (their `curve`)."""
        drawn = ((draw(moment, self.size, beside), lost) for moment, lost in self._moments)
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


def write_animation(path: Path, pictures: Sequence[Picture], times: Sequence[float]) -> None:
    """Write a .gif, which plays over and over, whole or not at all: the pictures at their ``times`` [s], `SPEED` times
    faster, and the last for two seconds."""
    from PIL import Image

    images = [Image.fromarray(picture) for picture in pictures]
    palette = images[-1].quantize(COLOURS, Image.Quantize.FASTOCTREE)  # the fullest picture has every colour
    first, *rest = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images)
    begins = [0]  # in hundredths of a second, the unit of the format; browsers show no picture for less than two
    for time in times[1:]:
        begins.append(max(begins[-1] + 2, round(100.0 * (time - times[0]) / SPEED)))
    durations = [*(10 * np.diff(begins)).tolist(), 2000]
    with written_whole(path) as unfinished:
        first.save(unfinished, "GIF", save_all=True, append_images=rest, duration=durations, loop=0, optimize=True)
