"""``ActiveSLAM-v0``: where should a camera go, and where should it look, to know the most?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from activeslam_gym.config import Scenario
from activeslam_gym.envs import readout
from activeslam_gym.envs.actions import action_space, discrete_action_space, motion_and_gaze, split_index
from activeslam_gym.envs.reads import SingleReads
from activeslam_gym.envs.setting import observation_space, render_rate, resolve
from activeslam_gym.envs.step import BEGIN, LOST, REWARD, STEPS, empty_runs, reset_run
from activeslam_gym.envs.views import Snapshot
from activeslam_gym.envs.workers import Workers
from activeslam_gym.motion import Gaze


class ActiveSLAMEnv(SingleReads, gymnasium.Env[np.ndarray, np.ndarray]):
    """A camera with six degrees of freedom maps a room by bearing-only EKF SLAM and is told where to go and to look.

    ## Description
    After Vidal-Calleja, Davison, Andrade-Cetto and Murray, *Active Control for Single Camera SLAM* (ICRA 2006). A true
    camera moves in a room of point landmarks and yields unlabelled, noisy pixels. An extended Kalman filter with one
    joint covariance of camera and map makes what it can of them. The agent moves the camera so that the filter knows
    the most.

    ## Action space
    `MultiDiscrete([7, 3])`: a translation of 0.3 m along the camera's axes (`Motion`: FORWARD, BACKWARDS, RIGHT, LEFT,
    UP, DOWN, STAY) and a turn about the vertical at 0.2 rad/s (`Gaze`: RIGHT, LEFT, STAY). One step is one
    `gaze_period`. Gaze acts at once; the translation is read on the first step of each `motion_period` and held until
    the period is over. `ActiveSLAMDiscrete-v0` takes `Discrete(21)` instead, index = 3 motion + gaze.

    ## Observation space
    A flat float32 `Box` in [-1, 1] of what the belief holds, nothing of the truth; `observation_layout(env)` names its
    parts: global features, then a token of equal width for each fiducial and each landmark slot.

    ## Reward
    The gain of a potential during the step, by default the entropy removed [bit], so that an episode's rewards sum to
    what was learned. A lost run forfeits it: its last reward adds -max(0, return so far). See `envs.reward`.

    ## Start
    A room drawn from the seed; the camera at its centre, at rest, facing six fiducials; its true pose drawn from the
    prior.

    ## End
    `truncated` at `duration`. `terminated` when lost: a true position error over `lost_position_error`, or a public
    covariance that is not positive definite.

    ## Arguments
    `scenario` (a name, a dict of fields or a `Scenario`), `gaze_period` [s] (None: one frame), `motion_period` [s],
    `duration` [s], `reward` (a name of `envs.reward.REWARDS`), `lost_position_error` [m], `render_mode`.

    ## Information
    `info` has `entropy` [bit], `log2_det` (camera, map, total), `log_score` [bit] (gain of the log density of the
    truth), `landmarks_mapped`, `distinct_landmarks`, `position_error` [m], `orientation_error` [rad], `landmark_rmse`
    [m], `position_nees`, `lost`, `reward_terms`, `events`.

    ## Version history
    v0: the first.

    Raises:
        ValueError: a bad argument or action; the message names it, its value and what is allowed.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 20}

    def __init__(
        self,
        scenario: str | Mapping[str, Any] | Scenario = "paper",
        gaze_period: float | None = None,
        motion_period: float = 1.0,
        duration: float = 35.0,
        reward: str = "entropy",
        lost_position_error: float = 0.5,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode must be None, 'human' or 'rgb_array', got {render_mode!r}")
        setting = resolve(scenario, gaze_period, motion_period, duration, reward, lost_position_error)
        super().__init__(setting, empty_runs(setting.scenario, 1), Workers(1))
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": render_rate(setting)}
        self.observation_space = observation_space(setting)
        self.action_space = self._make_action_space()
        self._motion_and_gaze = np.zeros((2, 1), np.int64)
        self._gaze = Gaze.STAY
        self._running = False
        self._history = readout.History()
        self._window: Any = None

    def _make_action_space(self) -> spaces.Space[Any]:
        return action_space()

    def _read_action(self, action: Any) -> tuple[int, int]:
        return motion_and_gaze(action)

    # Gymnasium ------------------------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a new run in a new room. The same seed gives the same run, whatever the actions the same noise."""
        super().reset(seed=seed)
        key = int(self.np_random.integers(2**63))
        reset_run(self.setting.scenario, self._run, key)
        self._play_one(BEGIN, Gaze.STAY)
        self._running = True
        self._gaze = Gaze.STAY
        self._history = readout.History()
        self._show()
        return self._run.step.observation.copy(), readout.info_of(self._run)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One gaze period under ``action``.

        Raises:
            ValueError: the action is outside the action space.
            gymnasium.error.ResetNeeded: the run has ended or has not begun.
        """
        if not self._running:
            raise gymnasium.error.ResetNeeded("the run has ended or has not begun: call reset() before step()")
        motion, gaze = self._read_action(action)
        self._play_one(motion, gaze)
        self._gaze = Gaze(gaze)
        step = self._run.step
        terminated = bool(step.status[LOST])
        truncated = bool(step.status[STEPS] >= self.setting.task.steps)
        self._running = not (terminated or truncated)
        if self.render_mode is not None:
            self._show()
        return step.observation.copy(), float(step.sums[REWARD]), terminated, truncated, readout.info_of(self._run)

    def _play_one(self, motion: int, gaze: int) -> None:
        self._motion_and_gaze[:, 0] = motion, gaze
        self._play(*self._motion_and_gaze)

    def render(self) -> np.ndarray | None:
        """The present moment as an (H, W, 3) uint8 image in ``rgb_array`` mode; nothing in ``human`` mode.

        Raises:
            gymnasium.error.ResetNeeded: there is nothing to draw before the first reset.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render() does nothing without a render_mode; make the environment with 'rgb_array'")
            return None
        if self.render_mode == "human":
            return None
        from activeslam_gym import rendering

        return rendering.draw(self.snapshot())

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _show(self) -> None:
        if self.render_mode is None:
            return
        self._history.record(self.time, self._run)
        if self.render_mode == "human":
            from activeslam_gym import rendering

            self._window = self._window or rendering.Window()
            self._window.show(self.snapshot())

    def snapshot(self) -> Snapshot:
        """All that a picture of this moment needs."""
        return readout.snapshot_of(self.setting, self._run, self._gaze, self._history)


class ActiveSLAMDiscreteEnv(ActiveSLAMEnv):
    """``ActiveSLAMDiscrete-v0``: the same with one integer for an action, index = 3 motion + gaze.

    Everything else is as in `ActiveSLAMEnv`.
    """

    def _make_action_space(self) -> spaces.Space[Any]:
        return discrete_action_space()

    def _read_action(self, action: Any) -> tuple[int, int]:
        return split_index(action)
