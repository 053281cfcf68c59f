"""`python -m activeslam_gym play`: the environment's own command line."""

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
    commands = top.add_subparsers(dest="command", required=True, metavar="play")
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
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command: the exit status, 1 where no window can be opened, 2 for a bad value, 130 for Ctrl-C."""
    args = parser().parse_args(arguments)
    try:
        rooms = play(args.seed, args.scenario, args.gaze_period, args.speed)
    except ValueError as error:
        print(f"python -m activeslam_gym play: {error}", file=sys.stderr)
        return 2
    except gymnasium.error.Error as error:
        print(f"python -m activeslam_gym play: {error}\n\nOn a screen these are the keys:\n{HELP}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    print("\n".join(rooms) or "No room was flown to its end.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
