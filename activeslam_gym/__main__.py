"""`python -m activeslam_gym play` and `track`: the environment's own command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import gymnasium

from activeslam_gym.play import HELP, play


def parser() -> argparse.ArgumentParser:
    """The commands and their options."""
    top = argparse.ArgumentParser(
        prog="python -m activeslam_gym", description="Active SLAM as a Gymnasium environment."
    )
    commands = top.add_subparsers(dest="command", required=True, metavar="play | track")
    flying = commands.add_parser(
        "play",
        help="fly the camera by hand",
        description="Fly the camera by hand, in a window; each action's scores stand beside the picture.",
        epilog=f"keys:\n{HELP}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    flying.add_argument("--seed", type=int, default=0, help="the first room (default: %(default)s)")
    flying.add_argument("--scenario", default="paper", help="the scenario's name (default: %(default)s)")
    flying.add_argument("--gaze-period", type=float, default=0.25, help="time of a step [s] (default: %(default)s)")
    flying.add_argument("--speed", type=float, default=1.0, help="1 is true time (default: %(default)s)")
    tracking = commands.add_parser(
        "track",
        help="track a real camera through images",
        description="Track a calibrated camera through images that begin before a target of known size: its "
        "trajectory, the map and a log of every image. Needs the extra `vision`.",
    )
    tracking.add_argument("--images", required=True, help="a folder, a pattern in quotes, or a video; 8-bit grey")
    tracking.add_argument("--calibration", required=True, help="JSON file with the lens")
    tracking.add_argument("--target", required=True, help="JSON file with the rectangle that the first image shows")
    tracking.add_argument("--rate", type=float, default=30.0, help="images a second (default: %(default)s)")
    tracking.add_argument("--out", required=True, help="folder for trajectory.tum, map.csv and frames.csv")
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command: the exit status.

    1: no window can be opened, OpenCV is not installed, or the track ended early; 2: a bad value or file; 130: Ctrl-C.
    """
    args = parser().parse_args(arguments)
    try:
        return _play(args) if args.command == "play" else _track(args)
    except (ValueError, OSError) as error:
        return _said(args, error, 2)
    except KeyboardInterrupt:
        return 130


def _play(args: argparse.Namespace) -> int:
    try:
        rooms = play(args.seed, args.scenario, args.gaze_period, args.speed)
    except gymnasium.error.Error as error:
        return _said(args, f"{error}\n\nOn a screen these are the keys:\n{HELP}", 1)
    print("\n".join(rooms) or "No room was flown to its end.")
    return 0


def _track(args: argparse.Namespace) -> int:
    from activeslam_gym.vision.track import summary, track

    try:
        done = track(args.images, args.calibration, args.target, args.rate, args.out)
    except ModuleNotFoundError as error:
        return _said(args, error, 1)
    print(f"{summary(done)}; results in {args.out}")
    return 0 if done.trouble is None else _said(args, f"ended early: {done.trouble}", 1)


def _said(args: argparse.Namespace, message: object, status: int) -> int:
    """Say what is wrong; the exit status."""
    print(f"python -m activeslam_gym {args.command}: {message}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
