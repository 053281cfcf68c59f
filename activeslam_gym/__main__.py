"""`python -m activeslam_gym live`, `track` and `calibrate`: the environment's own command line."""

import argparse
import signal
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import gymnasium

from activeslam_gym.vision.settings import TRACK_FEATURES

_DEFAULT = "(default: %(default)s)"
_LENS = "file of the lens: of calibrate, OpenCV, ROS, Kalibr, EuRoC, ORB-SLAM, Basalt or COLMAP"
_CAMERA = "camera of the file of the lens, by its name or the number in it (default: cam0, or the first)"


class _Parser(argparse.ArgumentParser):
    """Tells a mistake in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see --help)\n")


def parser() -> argparse.ArgumentParser:
    """The commands and their options; ``run`` is the function of the chosen one."""
    top = _Parser(prog="python -m activeslam_gym", description="Active SLAM as a Gymnasium environment.")
    commands = top.add_subparsers(dest="command", required=True, metavar="live | track | calibrate")
    for add in (_add_live, _add_track, _add_calibrate):
        add(commands)
    return top


def _add_live(commands: Any) -> None:
    one = commands.add_parser(
        "live",
        help="serve a page that advises, once a second, where to move the camera",
        description="Serve a page that shows the map, the camera's view, and once a second the most "
        "informative motion. Without hardware, a simulated person in a rendered room follows the advice. "
        "Needs the extra `live`.",
    )
    one.set_defaults(run=_live)
    source = (
        "rendered, a folder, a pattern in quotes, a list, a video, camera:0, or browser for the page's device's camera"
    )
    one.add_argument("--source", default="rendered", help=f"{source} {_DEFAULT}")
    one.add_argument("--calibration", help=f"{_LENS} (for a source that is not rendered)")
    one.add_argument("--camera", help=_CAMERA)
    one.add_argument("--target", help="JSON file of the target (for a source that is not rendered)")
    one.add_argument(
        "--calibrate", metavar="FILE", help="with --source browser, find the lens from a waved board and write it here"
    )
    one.add_argument("--rate", type=float, default=30.0, help=f"images a second of a folder or video {_DEFAULT}")
    one.add_argument("--seed", type=int, default=0, help=f"seed of the rendered room {_DEFAULT}")
    follow = f"always: the simulated person follows the advice; never: moves at random {_DEFAULT}"
    one.add_argument("--follow", default="always", choices=("always", "never"), help=follow)
    one.add_argument("--host", default="127.0.0.1", help=f"address to serve at; 0.0.0.0: every interface {_DEFAULT}")
    one.add_argument("--port", type=int, default=8080, help=f"port to serve at; 0 is any free one {_DEFAULT}")
    one.add_argument("--seconds", type=float, help="duration in seconds (default: until Ctrl-C)")
    one.add_argument("--record", metavar="DIR", help="folder in which to keep images, log, trajectory and map")
    one.add_argument("--film", action="store_true", help="with --record, write film.mp4 too: the images beside the map")


def _add_track(commands: Any) -> None:
    one = commands.add_parser(
        "track",
        help="track a real camera through images",
        description="Track a calibrated camera through images that begin before a target of known size (a rectangle, a "
        "ChArUco or an AprilTag board), or anywhere, without scale: its trajectory, the map and a log of every image. "
        "Needs the extra `vision`.",
    )
    one.set_defaults(run=_track)
    one.add_argument("--images", required=True, help="folder, pattern in quotes, list, video, or camera:0")
    one.add_argument("--calibration", required=True, help=_LENS)
    one.add_argument("--camera", help=_CAMERA)
    one.add_argument(
        "--target", help="JSON file of the target in the first image (default: none, and the scale is free)"
    )
    one.add_argument(
        "--rate", type=float, help="images a second, where no list has times (default: by their own, else 30)"
    )
    one.add_argument(
        "--times", metavar="FILE", help="times of the images: TUM's rgb.txt, EuRoC's data.csv, or a time a line"
    )
    readout = "seconds from the first row of an image to the last, of a rolling shutter; poses are the middle row's"
    one.add_argument("--readout", type=float, default=0.0, help=f"{readout} {_DEFAULT}")
    one.add_argument("--out", required=True, help="folder to write trajectory.tum, map.csv and frames.csv to")
    features = f"largest number of features in the map {_DEFAULT}"
    one.add_argument("--features", type=int, default=TRACK_FEATURES, help=features)
    one.add_argument("--film", action="store_true", help="write film.mp4 too: the images beside the map")
    one.add_argument("--belief", choices=("smfeval",), help="write poses and covariances to belief.square, for smfeval")
    one.add_argument("--keep-lost", action="store_true", help="write the poses of lost images to trajectory.tum too")


def _add_calibrate(commands: Any) -> None:
    one = commands.add_parser(
        "calibrate",
        help="find the lens from pictures of a board",
        description="Fit a lens to pictures of a chessboard or a ChArUco board (dictionary 4x4_50, "
        "markers of 3/4 of a square), held at different places, distances and angles. Needs the extra `vision`.",
    )
    one.set_defaults(run=_calibrate)
    one.add_argument("--images", required=True, help="folder, pattern in quotes, or video")
    one.add_argument("--kind", default="chessboard", help=f"kind of board: chessboard or charuco {_DEFAULT}")
    one.add_argument(
        "--columns",
        type=int,
        required=True,
        help="inner corners in a row of a chessboard, or squares of a ChArUco board",
    )
    one.add_argument(
        "--rows",
        type=int,
        required=True,
        help="inner corners in a column of a chessboard, or squares of a ChArUco board",
    )
    model = "lens model: that of the environment, or OpenCV's radtan or fisheye"
    one.add_argument(
        "--model", default="equation-1", choices=("equation-1", "radtan", "fisheye"), help=f"{model} {_DEFAULT}"
    )
    one.add_argument("--out", required=True, help="JSON file to write")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command: the exit status.

    1: a package is not installed, or the track ended early; 2: a bad value or file; 3: most images were lost, the start
    is uncertain, or map or lens contradict the images, or the map was replaced; 130: Ctrl-C, SIGTERM or SIGHUP.
    """
    args = parser().parse_args(arguments)
    try:
        status, trouble = args.run(args) or (0, None)
    except (gymnasium.error.Error, ModuleNotFoundError) as error:
        status, trouble = 1, error
    except (ValueError, OSError) as error:
        status, trouble = 2, error
    except KeyboardInterrupt:
        return 130
    if status:
        print(f"python -m activeslam_gym {args.command}: {trouble}", file=sys.stderr)
    return status


# Each runs its command and returns exit status and reason of a bad end, or None. -------------------------------------

Ending = tuple[int, str] | None


def _live(args: argparse.Namespace) -> Ending:
    from activeslam_gym.live.run import live

    trouble = live(args)
    return (1, f"ended early: {trouble}") if trouble else None


def _track(args: argparse.Namespace) -> Ending:
    from activeslam_gym.vision.track import summary, track

    done, advice = track(args)
    print(f"{summary(done)}; results in {args.out}")
    tracked, early = len(done.lost) - int(done.lost.sum()), done.trouble and f"ended early: {done.trouble}"
    if 2 * tracked < len(done.lost):
        counted = f"lost: {tracked} of {len(done.lost)} images were tracked; {advice}"
        return 3, f"{early}; {counted}" if early else counted
    if done.doubt:
        return 3, f"{early}; {done.doubt}" if early else done.doubt
    return (1, early) if early else None


def _calibrate(args: argparse.Namespace) -> None:
    from activeslam_gym.vision.board import calibrate

    fit = calibrate(args.images, args.kind, args.columns, args.rows, args.out, args.model)
    numbers = fit.calibration[2:]
    if fit.lens:
        K, bent = fit.lens.matrix, fit.lens.coefficients.tolist()
        numbers = (K[0, 0], K[0, 2], K[1, 2], bent[0])
        print(f"OpenCV's {args.model}, fx fy {K[0, 0]:.2f} {K[1, 1]:.2f}, bent by {' '.join(f'{x:.5f}' for x in bent)}")
    f, x, y, k = (f"{value:{form}}" for value, form in zip(numbers, (".2f", ".2f", ".2f", ".3e")))
    df, dx, dy, dk = (f" +- {std:{form}}" for std, form in zip(fit.stds, (".2f", ".2f", ".2f", ".0e")))
    print(
        f"{len(fit.kept)} pictures show the board; residual {fit.residual_px:.3f} px\n"
        f"focal_px {f}{df}, principal point ({x}{dx}, {y}{dy}), distortion {k}{dk}\nwritten to {args.out}"
    )


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # it ends a command as Ctrl-C does
    hangup = getattr(signal, "SIGHUP", signal.SIGTERM)  # and so does a terminal that is closed; not on Windows
    if signal.getsignal(hangup) != signal.SIG_IGN:
        signal.signal(hangup, signal.default_int_handler)
    sys.exit(main())
