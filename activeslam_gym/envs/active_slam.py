"""``ActiveSLAM-v0``: where should a camera go, and where should it look, to know the most?"""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from activeslam_gym.config import Scenario, whole_number
from activeslam_gym.envs.actions import INDICES, POINTS, checked_options
from activeslam_gym.envs.info import info_of
from activeslam_gym.envs.observation import observation_space
from activeslam_gym.envs.public import SingleReads
from activeslam_gym.envs.reset import empty_runs
from activeslam_gym.envs.reward import Potential
from activeslam_gym.envs.setting import checked_images, checked_rendering, resolve
from activeslam_gym.envs.snapshot import Snapshot, snapshot_of
from activeslam_gym.envs.step import BEGIN, STEP
from activeslam_gym.metrics import LOST_POSITION_ERROR
from activeslam_gym.threads import Workers


class ActiveSLAMEnv(SingleReads, gymnasium.Env[np.ndarray, np.ndarray]):
    """A camera with six degrees of freedom maps a room by bearing-only EKF SLAM; the agent chooses motion and gaze.

    ## Description

    After Vidal-Calleja, Davison, Andrade-Cetto and Murray, *Active Control for Single Camera SLAM* (ICRA 2006). A true
    camera moves in a room of point landmarks and yields unlabelled, noisy pixels. An extended Kalman filter estimates
    camera and map with one joint covariance. The agent moves the camera to reduce the filter's entropy.

    World axes: Y is up, X and Z are horizontal, the origin is the centre of the room. Camera axes: x left, y up,
    z forward. Below, N is the number of unknown landmarks (27 in the scenario `paper`), K that of fiducials (6).

    ## Action space

    `MultiDiscrete([7, 3])`, a motion and a gaze:

    | Index | Motion: a translation of 0.3 m | Gaze: a turn at 0.2 rad/s |
    |---|---|---|
    | 0 | FORWARD, along the camera's z | RIGHT, about the world's vertical |
    | 1 | BACKWARDS | LEFT |
    | 2 | RIGHT, against the camera's x | STAY: stop turning |
    | 3 | LEFT | |
    | 4 | UP, along the camera's y | |
    | 5 | DOWN | |
    | 6 | STAY: hold the position | |

    The enums `Motion` and `Gaze` have these names; the scenario's `step_length` and `turn_rate` can change the sizes.
    One step is one `gaze_period`. Gaze acts at once; the motion is read on the first step of each `motion_period`, from
    the estimated pose, and held until the period is over; later ones are ignored. Its goal is clipped to lie
    0.4 m inside the walls; where there are boxes or another scene, it ends 0.4 m before a body on its way.
    `ActiveSLAMDiscrete-v0` and `ActiveSLAMContinuous-v0` take other actions, see `ActiveSLAMDiscreteEnv` and
    `ActiveSLAMContinuousEnv`.

    ## Observation space

    A flat float32 `Box`, read from the state estimate and clipped to [-1, 1]. First the global features:

    | Feature | Size | What it is | Is 1 at |
    |---|---|---|---|
    | `position` | 3 | estimated position, world axes | a wall: half the room's size |
    | `forward` | 3 | the camera's z in world axes | unit vector |
    | `up` | 3 | the camera's y in world axes | unit vector |
    | `velocity` | 3 | estimated velocity, world axes | 1 m/s |
    | `angular_velocity` | 3 | estimated angular velocity, world axes | 1 rad/s |
    | `time` | 1 | time since the reset | `duration` |
    | `phase` | 1 | steps since the motion period began | `motion_period` |
    | `motion` | 7 | the motion under way, one-hot; STAY after a reset | |
    | `uncertainty` | 4 | log10(RMS deviation) / 3, of position [m], rotation [rad] and their rates | 10³ |
    | `mapped` | 1 | mapped features over N | N |
    | `counting` | 1 | features that took the place of an expected landmark, over N | N |
    | `features` | 1 | features in the filter over its slots | N + 13 |
    | `gain` | 1 | entropy removed since the reset, over the belief's dimensions 12 + 3 N | 10 bit per dimension |

    Where a scenario has boxes or another scene, range finders follow, which measure in the true room:

    | Feature | Size | What it is | Is 1 at |
    |---|---|---|---|
    | `clearance` | 7 | how far the camera can go by each motion before it touches something; STAY: the least | 3 m |

    Then K + N + 13 tokens of equal width: the fiducials, then the filter's feature slots, of which 13 are spare. A
    feature keeps its slot for life. An expected landmark is *retired* by the feature that takes its place; the others
    take free slots. A token that stands for nothing is zero.

    | Feature | Size | What it is | Is 1 at |
    |---|---|---|---|
    | `direction` | 3 | from the camera to the point, camera axes | unit vector |
    | `log_distance` | 1 | log10(distance [m]) / 1.5 | 32 m |
    | `log_uncertainty` | 1 | log10(deviation [m]) / 3, geometric mean of three axes | 10³ m |
    | `log_depth_uncertainty` | 1 | log10(deviation along the line of sight / distance) / 3 | 10³ |
    | `in_view` | 1 | 1 if its predicted pixel lies in the image | |
    | `fiducial` | 1 | 1 for a point of known position (its uncertainties are -1) | |
    | `expected` | 1 | 1 for a landmark that is expected and not found yet | |
    | `initialising` | 1 | 1 for a feature whose depth is not known well enough to be mapped | |
    | `mapped` | 1 | 1 for a mapped feature: deviation of its depth over its depth under 0.3 | |

    Deviations under 1 mm or 1 mrad count as that. `observation_layout(env)` gives these names and where each stands.
    The size, 32 + 11 (K + N + 13), and 7 more where there are range finders, depends on the scenario alone.

    ## Reward

    The gain of a potential during the step, by default (`reward="entropy"`) minus the entropy of the estimate [bit], so
    that an episode's rewards sum to the entropy reduction. The entropy is that of camera and N landmarks at a constant
    dimension: an expected landmark that no feature has retired holds its prior. `envs.reward` lists the potentials.
    Whatever the reward, a loss takes all that was gained and 100 bits more: in that step the return becomes
    min(return, 0) - 100, once, so that no loss pays.

    ## Start

    A room drawn from the seed: landmarks uniform in it, and the same number of *expected* landmarks, uniform too and
    independent of the true ones. The estimate is the mean of the prior: at the room's centre, at rest, facing K
    fiducials 1.2 to 2 m ahead; the true pose is drawn from the prior. Other scenarios start in a corner or anywhere,
    put landmarks on surfaces or in clusters, and draw boxes and walls, see `Scenario`. The noise of frame k does not
    depend on earlier actions, so that policies with the same seed are compared in pairs. `options` are ignored, with a
    warning.

    ## End

    - *Truncated* after `duration`.
    - *Terminated* when lost: the true position is farther than `lost_position_error` from the estimate, or the public
      covariance is not positive definite. Neither is ever an exception, and no number becomes NaN.
    - With `end_when_lost=False` a lost episode goes on to its `duration`: published tables use it, since an end that
      depends on the truth would stop a score where it falls. A covariance that is not positive definite has the log
      score -10 000 bits.

    ## Arguments

    | Argument | Default | What it is |
    |---|---|---|
    | `scenario` | `"paper"` | a name in `SCENARIOS`, a dict of the fields of `Scenario`, or a `Scenario` |
    | `gaze_period` | `None` | time of a step [s], whole frames; `None`: at most the scenario's (0.25 s) |
    | `motion_period` | `1.0` | time of a translation [s], whole gaze periods; under 0.42 it falls short |
    | `duration` | `None` | time of an episode [s], a whole number of gaze periods; `None`: the scenario's (35 s) |
    | `reward` | `"entropy"` | the potential: a name in `envs.reward.REWARDS`, or a function |
    | `lost_position_error` | `0.5` | true position error beyond which the episode is lost [m] |
    | `end_when_lost` | `True` | whether a lost episode is terminated |
    | `render_mode` | `None` | `"rgb_array"` or `"human"`, which needs a screen |
    | `render_size` | `(960, 640)` | width and height of the picture [px] |
    | `scene` | `None` | a scene in place of the scenario's: a name or an object |
    | `sensor` | `None` | the same of the sensor |
    | `estimator` | `None` | the same of the estimator |
    | `criterion` | `None` | the same of the criterion of policies that plan motions (`motion_criterion`) |

    ## Information

    `info` of every `reset` and `step`, of plain Python values; it reads the ground truth, so it is for the evaluator.

    | Key | Unit | What it is |
    |---|---|---|
    | `entropy` | bit | of camera and N landmarks, at constant dimension |
    | `log2_det` | bit | log2 of the determinant of the covariance of `camera`, `map` and `total` |
    | `log_score` | bit | log2 of the density of the truth under the belief, against that of the reset |
    | `landmarks_mapped` | | mapped features |
    | `distinct_landmarks` | | true landmarks that a mapped feature stands for |
    | `position_error` | m | of the camera |
    | `orientation_error` | rad | of the camera |
    | `landmark_rmse` | m | over the distinct landmarks; inf until there is one |
    | `position_nees` | | NEES of the camera's position per degree of freedom, as `nees()["position"]` |
    | `lost` | | whether the episode is lost, or was before |
    | `lost_at_end` | | whether it is lost at the moment |
    | `reward_terms` | | gain of every potential of `envs.reward` in this step, and `lost_penalty` |
    | `events` | | counts in this step, see below |

    | Event | What it counts |
    |---|---|
    | `initialised` | features that joined the filter |
    | `conversions` | features that became points; 0 with a foreign estimator |
    | `deletions` | features that left the filter |
    | `rejected_matches` | detections in a gate that were too ambiguous to be used |
    | `restarts` | times that the fiducials contradicted the belief, and it was reset; 0 with a foreign estimator |
    | `wrong_matches` | matches with another point than that of the feature |
    | `false_features` | features that were initialised from clutter |
    | `wall_contacts` | frames and axes in which the camera touched a wall, and frames and bodies that it touched |

    ## Version history

    - v0: the first.

    Raises:
        ValueError: a bad argument or action; the message names it, its value and what is allowed.
        TypeError: there is no such argument.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 20}

    def __init__(
        self,
        scenario: str | Mapping[str, Any] | Scenario = "paper",
        gaze_period: float | None = None,
        motion_period: float = 1.0,
        duration: float | None = None,
        reward: str | Potential = "entropy",
        lost_position_error: float = LOST_POSITION_ERROR,
        end_when_lost: bool = True,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (960, 640),
        scene: Any = None,
        sensor: Any = None,
        estimator: Any = None,
        criterion: Any = None,
        **unknown: Any,
    ) -> None:
        modes = self.metadata["render_modes"]
        self.render_mode, self.render_size = checked_rendering(render_mode, modes, render_size)
        given = scenario, gaze_period, motion_period, duration, reward, lost_position_error, end_when_lost
        setting = resolve(*given, scene=scene, sensor=sensor, estimator=estimator, criterion=criterion, **unknown)
        super().__init__(setting, empty_runs(setting.scenario, 1), Workers(1))
        self.metadata = {**self.metadata, "render_fps": setting.render_rate}
        self.observation_space = observation_space(setting.layout)
        self.action_space = self._encoding.space()
        self._steps = int(setting.task.steps)
        self._running = False
        self._window: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a new episode in a new room. The same seed gives the same episode, whatever the actions the same noise.

        Raises:
            ValueError: ``seed`` is no whole number of 0 or more, or ``options`` no dict.
        """
        checked_options(options)
        super().reset(seed=None if seed is None else whole_number("seed", seed, 0))
        key = int(self.np_random.integers(2**63))
        self._running = False
        self._reset_run(0, key)
        self._play(BEGIN, 0.0)
        self._running = True
        self._show()
        return self._runs.observation[0].copy(), info_of(self._runs, self.setting.reward)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One gaze period under ``action``.

        Raises:
            ValueError: the action is outside the action space.
            gymnasium.error.ResetNeeded: the episode has ended or has not begun.
        """
        if not self._running:
            raise gymnasium.error.ResetNeeded("the episode has ended or has not begun: call reset() before step()")
        self._play(STEP, self._encoding.read_one(action))
        episode, observation = self._runs.episode, self._runs.observation[0].copy()
        terminated = self._end_when_lost and bool(episode["lost"][0])
        truncated = bool(episode["steps"][0] >= self._steps)
        self._running = not (terminated or truncated)
        self._show()
        return observation, float(episode["reward"][0]), terminated, truncated, info_of(self._runs, self.setting.reward)

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
        from activeslam_gym.rendering.picture import draw

        return draw(self.snapshot(), self.render_size)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _show(self) -> None:
        if self.render_mode == "human":
            from activeslam_gym.rendering.picture import Window

            self._window = self._window or Window(self.render_size)
            self._window.show(self.snapshot())

    def snapshot(self) -> Snapshot:
        """All that a picture of this moment needs.

        Raises:
            gymnasium.error.ResetNeeded: no episode has begun.
        """
        return snapshot_of(self, 0)


class ActiveSLAMDiscreteEnv(ActiveSLAMEnv):
    """``ActiveSLAMDiscrete-v0``: the same with one integer for an action, index = 3 motion + gaze.

    Everything else is as in `ActiveSLAMEnv`.
    """

    _encoding = INDICES


class ActiveSLAMContinuousEnv(ActiveSLAMEnv):
    """``ActiveSLAMContinuous-v0``: the same with any translation of up to a step, and any turn rate up to the greatest.

    An action is four numbers of `Box(-1, 1, (4,))`: a displacement in camera axes (x left, y up, z forward), of which
    1 is the scenario's `step_length` (one that is longer is shortened to it), and a share of the `turn_rate` about the
    vertical, positive to the left. The 21 actions of `ActiveSLAM-v0` are points of it, `motion.COMMANDS`, and give the
    same episode to the bit. The observation's `motion` holds what share of each of the seven motions is under way.

    Everything else is as in `ActiveSLAMEnv`.
    """

    _encoding = POINTS


class ActiveSLAMPixelsEnv(ActiveSLAMEnv):
    """``ActiveSLAMPixels-v0``: the same actions, observation, rewards, scores and ends, on images of a textured room.

    The room has textured walls, posters, and boxes that hide what is behind them. Its image is rendered through the
    lens, with noise, blur of motion and drifting gain, and is a function of the seed, the frame and the camera's true
    state alone. The front end of `vision` searches the features of the belief in it, and adds and drops features. The
    fiducials are the four corners of a black rectangle of known size, which hangs before the start.

    What differs:

    - ``scenario`` is ``"pixels"`` by default. Its ``fiducial_count`` must be 4, its ``initialisation``
      ``inverse_depth``, and it must have no ``boxes`` (drawn ones and inner walls neither), no clutter, no missed
      detections and no labelled first match: the image has its own. The start is not ``anywhere``; the layout of the
      landmarks is ``uniform``, a furnished room whose walls, floor and boxes have textures, or ``clusters``: a bare
      room with ``cluster_count`` groups of posters on its walls. The greatest distance stays as in ``paper``, and
      nothing is varied. The front end associates and deletes features by their looks, so that ``association``,
      ``restarts``, ``maximum_misses``, ``miss_spacing``, ``inverse_depth_memory`` and ``new_feature_gate_probability``
      must keep their defaults; and so must fields of depth particles, boxes, doors, ``cluster_std``, ``facing_angle``.
    - ``landmark_count``, N, bounds the map (N + 13 features) instead of telling how many points the room has.
    - Truth of a landmark is the scene point that its feature follows, by ray-casting. Of the N slots of the log
      score, one without a feature scores a random point of the room by the prior.
    - A match is wrong where the feature's scene point is more than 4 pixels from it in the true image.
    - The room's boxes stop the camera, and a motion stops short of them; the belief knows nothing of them, and no range
      finder measures them.

    Raises:
        ValueError: a bad argument or action.
        ModuleNotFoundError: OpenCV is not installed.
    """

    def __init__(
        self, scenario: str | Mapping[str, Any] | Scenario = "pixels", *, sensor: Any = None, **arguments: Any
    ) -> None:
        super().__init__(scenario, sensor=checked_images(sensor), **arguments)

    @property
    def image(self) -> np.ndarray:
        """(H, W) uint8 the last image; a copy."""
        return self._perceptions[0].image.copy()
