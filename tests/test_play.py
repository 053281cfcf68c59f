"""Flying by hand: what each key means, the loop under scripted keys, the window, the command line."""

from collections.abc import Iterable, Iterator, Mapping
from functools import reduce
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym import Gaze, Motion, play
from activeslam_gym.__main__ import main
from activeslam_gym.rendering.window import SCORES_WIDTH


def after(*keys: str) -> play.Pilot:
    """What is asked for after these keys."""
    return reduce(lambda pilot, key: play.pilot_after(key, pilot), keys, play.Pilot())


KEYS = {key: (motion, Gaze.STAY) for key, motion in zip("up down d a pageup pagedown".split(), Motion)}
KEYS |= {"left": (Motion.STAY, Gaze.LEFT), "right": (Motion.STAY, Gaze.RIGHT)}


def test_every_action_has_a_key_and_the_help_names_it() -> None:
    for key in (*KEYS, " ", "f12"):
        assert play.command_after(key, play.Command()) == KEYS.get(key, (Motion.STAY, Gaze.STAY))
    assert set(play.MOTION_KEYS.values()) == set(Motion) - {Motion.STAY}
    assert set(play.GAZE_KEYS.values()) == set(Gaze) - {Gaze.STAY}
    for key in (*play.MOTION_KEYS, *play.GAZE_KEYS):
        assert key.removeprefix("page") in play.HELP
    assert [len(group) for group in play.labels()] == [len(Motion), len(Gaze)]


def test_moving_and_turning_go_together_and_the_same_key_stops_its_own() -> None:
    assert after("up", "left").command == (Motion.FORWARD, Gaze.LEFT)
    assert after("up", "left", "up").command == (Motion.STAY, Gaze.LEFT)
    assert after("up", "left", "left").command == (Motion.FORWARD, Gaze.STAY)
    assert after("up", "left", "w").command == (Motion.STAY, Gaze.LEFT)
    assert after("left", "right").command.gaze == Gaze.RIGHT
    assert after("up", "left", " ").command == play.Command()
    assert after("W").command.motion == Motion.FORWARD


def test_the_first_command_starts_the_clock_and_a_pause_holds_it() -> None:
    for keys in ((), ("f12", " "), ("up", "p"), ("up", "p", "left", " ", "down")):
        assert not after(*keys).running
    for keys in (("up",), ("p",), ("up", "p", "p")):
        assert after(*keys).running
    assert after("up", "p", "p").command.motion == Motion.FORWARD
    assert after("up", ".") == play.Pilot(play.Command(Motion.FORWARD), running=False, started=True, one_step=True)
    assert after("up", "n") == play.Pilot(new_room=True)
    assert after("up", "escape").quit


class Scripted:
    """A window whose user presses these keys, a list for each time it is asked, and then closes it."""

    def __init__(self, *script: Iterable[str]) -> None:
        self.script: Iterator[Iterable[str]] = iter(script)
        self.is_open = True
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
    return gym.make("ActiveSLAM-v0", gaze_period=0.25, render_mode="rgb_array", **kwargs)


def room(seed: int) -> Any:
    """The environment itself, at the start of a room."""
    core = make().unwrapped
    core.reset(seed=seed)
    return core


def test_it_flies_what_the_keys_say_and_a_pause_holds_the_time() -> None:
    cockpit = Scripted([], ["up"], [], ["left"], [])
    assert play.fly(make(), cockpit, seed=4) == []
    assert cockpit.times == [0.0, 0.25, 0.5, 0.75, 1.0]
    last, _, chosen, _ = cockpit.shown[-1]
    assert (last.motion, last.gaze) == (Motion.FORWARD, Gaze.LEFT)
    assert chosen == [Motion.FORWARD, len(Motion) + Gaze.LEFT]
    assert len(last.true_trajectory) == 5

    core = room(4)
    for action in [(0, 2), (0, 2), (0, 1), (0, 1)]:
        core.step(np.array(action))
    np.testing.assert_array_equal(last.true_position, core.truth.position)
    cockpit = Scripted(["up"], ["p"], [], ["left"], ["."], [], ["p"], [])
    play.fly(make(), cockpit)
    assert cockpit.times == [0.0, 0.25, 0.25, 0.25, 0.5, 0.75, 1.0]


def test_each_action_s_scores_are_shown_of_the_present_moment() -> None:
    cockpit = Scripted(["right"], [])
    play.fly(make(), cockpit, seed=4)
    core = room(4)
    for step in range(2):
        for title, values in play.action_scores(core).items():
            np.testing.assert_array_equal(cockpit.shown[step][1][title], values)
            assert values.shape == (10,) and values.max() > 0.0
        core.step(np.array([6, 0]))


def test_an_episode_ends_with_its_summary_and_n_is_the_next_room() -> None:
    cockpit = Scripted(["left"], [], [], [], [], ["n"], [])
    told = play.fly(make(duration=1.0), cockpit, seed=7)
    assert len(told) == 1
    assert told[0].startswith("Room 7: ") and "bits removed" in told[0]
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
    scores = play.action_scores(core)
    pictures = []
    for chosen in ((0, 9), (3, 8)):
        cockpit.show(core.snapshot(), scores, chosen, "a caption")
        pictures.append(np.asarray(cockpit._figure.canvas.buffer_rgba()).copy())
    width, height = rendering.COCKPIT_SIZE
    assert pictures[0].shape == (height, width, 4)
    changed = np.argwhere((pictures[0] != pictures[1]).any(axis=2))
    assert len(changed) and changed[:, 1].min() > width / (1 + SCORES_WIDTH)  # the scores alone, not the picture

    press(screen, "left", "up")
    assert cockpit.keys(0.01) == ["left", "up"]
    assert cockpit.keys(0.01) == []
    assert cockpit.is_open
    screen.close("all")
    assert not cockpit.is_open
    cockpit.show(core.snapshot(), scores, (0, 9), "")
    assert cockpit.keys(0.01) == []
    cockpit.close()


def test_the_command_flies_until_the_window_is_closed(
    screen: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from activeslam_gym import rendering

    script = iter([["left"], ["p"], ["escape"]])

    def keys(cockpit: rendering.Cockpit, seconds: float) -> list[str]:
        press(screen, *next(script))
        pressed, cockpit._pressed = cockpit._pressed, []
        return pressed

    monkeypatch.setattr(rendering.Cockpit, "keys", keys)
    assert main(["play", "--seed", "5"]) == 0
    assert "No room was flown to its end" in capsys.readouterr().out
    assert not screen.get_fignums()


@pytest.mark.usefixtures("no_screen")
def test_without_a_screen_the_command_says_so_and_names_the_keys(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["play"]) == 1
    error = capsys.readouterr().err
    assert "screen" in error and play.HELP in error
    with pytest.raises(SystemExit) as leaving:
        main(["play", "--help"])
    assert leaving.value.code == 0 and play.HELP in capsys.readouterr().out
    for option, value in (("--scenario", "nowhere"), ("--gaze-period", "0.07"), ("--speed", "0")):
        assert main(["play", option, value]) == 2
        assert option.removeprefix("--").replace("-", "_") in capsys.readouterr().err
