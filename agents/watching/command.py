"""`python -m agents watch`: an episode of one policy, or of several side by side."""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

from activeslam_gym.evaluation import Observer, outcome
from activeslam_gym.rendering import NoScreenWarning
from activeslam_gym.vision.film import check_video
from agents.task import check, file_name, make_environment, run_policy
from agents.tools.arguments import SEEDS, given, positive, scenario_argument, within
from agents.tools.files import writable_file, writable_folder
from agents.watching.film import SUFFIXES, Film, side_by_side, write_animation

LONGEST = 60.0  # of a picture of the animation [s]


@dataclass(frozen=True)
class Args:
    """Watch an episode in a window or, with --save or --tum, in files."""

    policies: tuple[str, ...] = ("mi-fisher",)
    """Policies: names, weight files (.npz), models of Stable-Baselines3 (.zip) or 'package.module:factory'."""
    seed: int = 1_000_000
    """Seed of the episode."""
    scenario: str = "paper"
    """Scenario: a name, fields as JSON, a file of such JSON or 'package.module:name'."""
    gaze_period: float | None = None
    """Seconds of a step; the scenario's if not given."""
    duration: float | None = None
    """Seconds of the episode; the scenario's if not given."""
    save: Path | None = None
    """File for an animation of all policies side by side: .gif, .webp, .png or .mp4."""
    every: float = 0.5
    """Seconds of the episode between two pictures of the animation."""
    speed: float = 4.0
    """How many times faster than life the animation plays."""
    width: int = 640
    """Width in pixels of each policy's picture, which is two thirds as high."""
    tum: Path | None = None
    """Folder for the true and the estimated trajectories in TUM's format."""

    def check(self) -> None:
        """Raises ValueError for a bad argument; the message names it, its value and what is allowed."""
        given(self, "policies")
        within(self, seed=SEEDS, width=(64, 4096))
        positive(self, "every", "speed")
        if self.every / self.speed > LONGEST:
            raise ValueError(f"speed: {self.speed!r} shows a picture for more than {LONGEST:g} s; allowed: faster")
        if self.save is not None and self.save.suffix not in SUFFIXES:
            raise ValueError(f"save must end in {', '.join(SUFFIXES)}, got {str(self.save)!r}")
        if self.save is not None and self.save.suffix == ".mp4":
            check_video(self.save)
        check(self.policies, [self.environment])
        if self.save:
            writable_file("save", self.save)
        if self.tum:
            writable_folder("tum", self.tum)

    @property
    def environment(self) -> dict[str, Any]:
        """Arguments of the environment; it draws in a window where nothing is to be written."""
        in_window = self.save is None and self.tum is None
        return {
            "scenario": scenario_argument(self.scenario),
            "gaze_period": self.gaze_period,
            "duration": self.duration,
            "render_mode": "human" if in_window else "rgb_array",  # which keeps the history that a picture shows
        }


def main(args: Args) -> int:
    """Run the command; the exit status. Raises as `watch`, and ValueError for a bad argument."""
    args.check()
    for path in watch(args):
        print(f"Written to {path}")
    return 0


def watch(args: Args) -> Iterator[Path]:
    """Run each policy's episode, and yield the files once they are written.

    Raises:
        ValueError: an unknown policy, or a bad argument of the environment.
        ImportError, gymnasium.error.Error: a package that draws, or a screen, is missing.
    """
    films, titles = [], labels(args.policies)
    for name, title in titles.items():
        film, env = Film(args.every, args.width), make_environment(args.environment)
        observers: list[Observer] = [film.observe] if args.save else []
        with warnings.catch_warnings():
            warnings.simplefilter("error", NoScreenWarning)
            try:
                (episode,) = run_policy(name, env, [args.seed], observers=[observers])
            except NoScreenWarning as warning:
                message = "no screen was found to watch on; --save clip.gif or --tum write files instead"
                raise gym.error.Error(message) from warning
        row = outcome(episode)
        end = "lost" if episode.lost else f"{row['bits']:.0f} bits of entropy reduction"
        print(
            f"{label(name)}, episode {args.seed}: {end} (log score gain {row['log_score_gain']:.0f} bits), "
            f"{row['distinct_landmarks']} landmarks mapped, camera {100 * row['position_error']:.1f} cm off"
        )
        if args.tum:
            yield from episode.write_trajectories(args.tum, f"{title}-{args.seed}")
        films.append(film)
    if args.save:
        curves = [film.curve for film in films] if len(films) > 1 else []
        pictures = side_by_side([film.pictures(curves) for film in films], list(titles.values()))
        write_animation(args.save, pictures, args.every / args.speed)
        yield args.save


def labels(names: Sequence[str]) -> dict[str, str]:
    """Each policy's name once, and its title: its `label`, or `file_name` where others have that label too."""
    short = {name: label(name) for name in names}
    return {name: one if list(short.values()).count(one) == 1 else file_name(name) for name, one in short.items()}


def label(name: str) -> str:
    """A policy's name as part of a file's name: the stem of a file of weights, the factory of a user's own."""
    return Path(name.rpartition(":")[2]).stem
