"""Flying by hand: each key's meaning, the loop under scripted keys, the window, the command line."""

from collections.abc import Iterable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym import Gaze, Motion, play
from activeslam_gym.__main__ import main
from activeslam_gym.rendering.window import SCORES_WIDTH

STAY = (Motion.STAY, Gaze.STAY)


class Still:
    """An environment that is never stepped."""

    unwrapped = property(lambda self: self)

    def reset(self, seed: int) -> tuple[None, dict[str, float]]:
        return None, {"entropy": 0.0}

    def motion_scores(self, criterion: str) -> np.ndarray:
        return np.zeros(7)

    gaze_scores = motion_scores


def after(*keys: str) -> play.Flight:
    """A flight after these keys."""
    flight: Any = play.Flight(Still(), 0)  # type: ignore[arg-type]
    for key in keys:
        flight.press(key)
    flight.command = (flight.motion, flight.gaze)
    return flight


def test_every_action_has_a_key_and_the_help_names_it() -> None:
    keys = {key: (motion, Gaze.STAY) for key, motion in zip("up down d a pageup pagedown".split(), Motion)}
    keys |= {"left": (Motion.STAY, Gaze.LEFT), "right": (Motion.STAY, Gaze.RIGHT)}
    for key in (*keys, " ", "f12"):
        assert after(key).command == keys.get(key, STAY)
    assert set(play.MOTION_KEYS.values()) == set(Motion) - {Motion.STAY}
    assert set(play.GAZE_KEYS.values()) == set(Gaze) - {Gaze.STAY}
    assert all(key.removeprefix("page") in play.HELP for key in (*play.MOTION_KEYS, *play.GAZE_KEYS))
    assert [len(group) for group in play.labels()] == [len(Motion), len(Gaze)]
    assert play.labels()[0][0] == "FORWARD  up" and play.labels()[1][-1] == "gaze STAY  space"


def test_moving_and_turning_go_together_and_the_same_key_stops_its_own() -> None:
    assert after("up", "left").command == (Motion.FORWARD, Gaze.LEFT)
    assert after("up", "left", "up").command == after("up", "left", "w").command == (Motion.STAY, Gaze.LEFT)
    assert after("up", "left", "left").command == (Motion.FORWARD, Gaze.STAY)
    assert after("left", "right").command == (Motion.STAY, Gaze.RIGHT)
    assert after("up", "left", " ").command == STAY
    assert after("W").command == (Motion.FORWARD, Gaze.STAY)


def test_the_first_command_starts_the_clock_and_a_pause_holds_it() -> None:
    for keys in ((), ("f12", " "), ("up", "p"), ("up", "p", "left", " ", "down"), ("up", "."), ("up", "n")):
        assert not after(*keys).running
    for keys in (("up",), ("p",), ("up", "p", "p")):
        assert after(*keys).running
    assert after("up", "p", "p").command == after("up", ".").command == (Motion.FORWARD, Gaze.STAY)
    assert after("up", "n").command == STAY and after("up", "n").seed == 1
    assert after("up", "escape").quit


class Scripted:
    """A window whose user presses these keys, a list for each time it is asked, and then closes it."""

    def __init__(self, *script: Iterable[str]) -> None:
        self.script, self.is_open = iter(script), True
        self.shown: list[tuple[Any, Mapping[str, np.ndarray], list[int], str]] = []

    def show(self, snapshot: Any, scores: Mapping[str, np.ndarray], chosen: Iterable[int], caption: str) -> None:
        self.shown.append((snapshot, scores, list(chosen), caption))

    def keys(self, seconds: float) -> list[str]:
        assert seconds > 0.0
        pressed = next(self.script, None)
        self.is_open = pressed is not None
        return list(pressed or [])

    @property
    def times(self) -> list[float]:
        return [snapshot.time for snapshot, *_ in self.shown]


def make(**kwargs: Any) -> gym.Env:
    return gym.make("ActiveSLAM-v0", render_mode="rgb_array", **kwargs)


def room(seed: int) -> Any:
    """The environment itself, at the start of a room."""
    core = make().unwrapped
    core.reset(seed=seed)
    return core


def test_it_flies_as_the_keys_say_with_the_scores_of_the_moment_and_a_pause_holds_the_time() -> None:
    cockpit, core = Scripted([], ["up"], [], ["left"], []), room(4)
    assert play.fly(make(), cockpit, seed=4) == []
    assert cockpit.times == [0.0, 0.25, 0.5, 0.75, 1.0]
    for (_, scores, *_), action in zip(cockpit.shown, [(0, 2), (0, 2), (0, 1), (0, 1)]):
        for title, values in play.action_scores(core).items():
            np.testing.assert_array_equal(scores[title], values)
            assert values.shape == (10,) and values.max() > 0.0
        core.step(np.array(action))
    last, _, chosen, _ = cockpit.shown[-1]
    assert (last.motion, last.gaze) == (Motion.FORWARD, Gaze.LEFT) and len(last.true_trajectory) == 5
    assert chosen == [Motion.FORWARD, len(Motion) + Gaze.LEFT]
    np.testing.assert_array_equal(last.true_position, core.truth.position)
    cockpit = Scripted(["up"], ["p"], [], ["left"], ["."], [], ["p"], [])
    play.fly(make(), cockpit)
    assert cockpit.times == [0.0, 0.25, 0.25, 0.25, 0.5, 0.75, 1.0]


def test_an_episode_ends_with_its_summary_and_n_is_the_next_room() -> None:
    cockpit = Scripted(["left"], [], [], [], [], ["n"], [])
    (told,) = play.fly(make(duration=1.0), cockpit, seed=7)
    assert told.startswith("Room 7: ") and "bits of entropy reduction" in told
    assert cockpit.times == [0.0, 0.25, 0.5, 0.75, 1.0, 0.0]
    np.testing.assert_array_equal(cockpit.shown[-1][0].true_landmarks, room(8).truth.landmarks)
    cockpit = Scripted(["left"], *[[]] * 20, ["escape"])
    (told,) = play.fly(make(lost_position_error=1e-4), cockpit)
    assert "lost" in told and "removed" not in told


def press(pyplot: Any, *keys: str) -> None:
    """The user presses keys in the open window."""
    from matplotlib.backend_bases import KeyEvent

    canvas = pyplot.figure(pyplot.get_fignums()[0]).canvas
    for key in keys:
        KeyEvent("key_press_event", canvas, key)._process()


def test_the_window_shows_the_scores_and_hears_the_keys(screen: Any) -> None:
    from activeslam_gym import rendering

    core, cockpit = room(1), rendering.Cockpit(play.labels())
    scores, pictures = play.action_scores(core), []
    for chosen in ((0, 9), (3, 8)):
        cockpit.show(core.snapshot(), scores, chosen, "a caption")
        pictures.append(np.asarray(cockpit._figure.canvas.buffer_rgba()).copy())
    width, height = rendering.COCKPIT_SIZE
    assert pictures[0].shape == (height, width, 4)
    changed = np.argwhere((pictures[0] != pictures[1]).any(axis=2))
    assert len(changed) and changed[:, 1].min() > width / (1 + SCORES_WIDTH)  # the scores alone, not the picture

    press(screen, "left", "up")
    assert cockpit.keys(0.01) == ["left", "up"] and cockpit.keys(0.01) == [] and cockpit.is_open
    screen.close("all")
    assert not cockpit.is_open
    cockpit.show(core.snapshot(), scores, (0, 9), "")
    assert cockpit.keys(0.01) == []
    cockpit.close()


def test_the_command_flies_until_the_user_leaves(screen: Any, monkeypatch: Any, capsys: Any) -> None:
    from activeslam_gym import rendering

    script = iter([["left"], ["p"], ["escape"]])
    plain = rendering.Cockpit.keys
    monkeypatch.setattr(
        rendering.Cockpit, "keys", lambda cockpit, _: press(screen, *next(script)) or plain(cockpit, 0.01)
    )
    assert main(["play", "--seed", "5"]) == 0
    assert "No room was flown to its end" in capsys.readouterr().out
    assert not screen.get_fignums()


@pytest.mark.usefixtures("no_screen")
def test_without_a_screen_the_command_says_so_and_names_the_keys(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["play"]) == 1
    error = capsys.readouterr().err
    assert "screen" in error and play.HELP in error
    with pytest.raises(SystemExit):
        main(["play", "--help"])
    assert play.HELP in capsys.readouterr().out
    for option, value in (("--scenario", "nowhere"), ("--gaze-period", "0.07"), ("--speed", "0")):
        assert main(["play", option, value]) == 2
        assert option.removeprefix("--").replace("-", "_") in capsys.readouterr().err
