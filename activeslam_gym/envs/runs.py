"""Runs of one setting that are reset, stepped and read together: what single and vector environments have in common."""

from typing import Any

import numpy as np

from activeslam_gym.envs.actions import INDICES, PAIRS, Encoding
from activeslam_gym.envs.evaluation import give_reward, landmark_errors
from activeslam_gym.envs.observation import context_of
from activeslam_gym.envs.perception import Perception, PointPerception, PythonPerception, step_runs_in_python
from activeslam_gym.envs.reset import Start, box_scene, reset_run
from activeslam_gym.envs.run import Run, complete
from activeslam_gym.envs.setting import Setting
from activeslam_gym.envs.step import REST, STEP, step_runs
from activeslam_gym.kernels import row, uncompiled
from activeslam_gym.motion import GAZE_COUNT, MOTION_COUNT, POSITION, nearest_motion
from activeslam_gym.registry import FOREIGN, number_from
from activeslam_gym.sensors.sensor import CORNERS, IMAGES, POINTS, TEXTURED
from activeslam_gym.slam.estimate import COMPILED
from activeslam_gym.threads import Workers
from activeslam_gym.world.scenes import Scene


def perception_of(setting: Setting, run: Run, start: Start, key: int) -> Perception:
    """The perception of a run that has just been reset from ``key`` to that ``start``."""
    seed = np.random.SeedSequence(key).spawn(5)[-1]  # the redraws use it, and not its children
    if setting.scenario.sensor == IMAGES:
        from activeslam_gym.envs.images import ImagePerception

        return ImagePerception(setting, run, start.mean[:7], seed)
    if setting.scenario.sensor == CORNERS:
        from activeslam_gym.envs.corners import CornerPerception

        return CornerPerception(setting, run, start.mean[:7], seed)
    if setting.scenario.sensor == POINTS and setting.scenario.estimator in COMPILED:
        return PointPerception(start.scene)
    return PythonPerception(run, start, seed)


class Runs:
    """The part that a single environment and a batch share: B runs, their `Perception` and threads, and the past.

    A *run* is the arrays of one environment (`run.Run`), with a leading axis in ``_runs``; its EPISODE is its progress
    since the reset.
    """

    _encoding: Encoding = PAIRS
    _single = False  # whether it is a batch of one that is read as a single environment
    render_mode: str | None = None

    def __init__(self, setting: Setting, runs: Run, workers: Workers) -> None:
        task = setting.task
        self.setting, self.scenario = setting, setting.scenario
        self.gaze_period, self.motion_period = setting.gaze_period, setting.motion_period
        """Times of a step and of a translation [s]."""
        self.duration = setting.duration
        """Time of an episode [s]."""
        self.steps_per_motion = int(task.steps_per_motion)
        """Steps in a motion period."""
        self._runs, self._workers = runs, workers
        in_python = setting.scenario.sensor != POINTS or setting.scenario.has_foreign_scene
        self._compiled = setting.scenario.estimator in COMPILED and not in_python  # a step is one kernel
        self._foreign_reward = int(task.reward) == FOREIGN  # a field of a record is slow to read
        self._end_when_lost = bool(task.end_when_lost)
        count = len(runs.episode)
        self._orders, self._commands = np.zeros(count, np.int64), np.zeros((count, 4))
        self._perceptions = np.full(count, None, object)  # an array, of which `run` has a view
        self._past: list[list[np.ndarray]] = [[] for _ in range(count)]  # moments (9,) for pictures, see `_remember`

    def _reset_run(self, i: int, key: int) -> None:
        """Give run ``i`` a new room from ``key``; it is to BEGIN next."""
        with self._workers.alone:
            self._runs.episode["begun"][i] = False
            start = reset_run(self.setting, self._runs, i, key)
            if not self._compiled:
                self._perceptions[i] = perception_of(self.setting, row(self._runs, i), start, key)
            self._runs.episode["begun"][i] = True
        self._past[i] = []

    def _play(self, orders: Any, commands: Any) -> None:
        """Carry out ``orders`` (B,) and ``commands`` (B, 4), or one for all; see `step.step_runs`."""
        self._orders[:], self._commands[:] = orders, commands
        if self._compiled:
            self._workers.call(step_runs, self._runs, self._orders, self._commands)
        elif self.scenario.sensor in TEXTURED:
            self._workers.call(step_runs_in_python, self._runs, self._perceptions, self._orders, self._commands)
        else:  # parts in Python, whose threads would wait for each other
            with self._workers.alone:
                everyone = 0, len(self._orders)
                step_runs_in_python(self._runs, self._perceptions, self._orders, self._commands, *everyone)
        if self._foreign_reward:
            self._give_foreign_rewards()
        if self.render_mode is not None:
            for i in np.flatnonzero(self._orders != REST).tolist():
                self._remember(i)

    def _remember(self, i: int) -> None:
        """Add a moment to the past of run ``i``: time, entropy, mapped landmarks, and true and estimated position."""
        run = row(self._runs, i)
        evaluation, cameras = run.episode.evaluation, (run.world.state.camera, run.estimate.state.camera)
        now = run.episode.steps * self.gaze_period, evaluation.entropy, evaluation.landmarks_mapped
        self._past[i].append(np.concatenate((now, *(camera[POSITION] for camera in cameras))))

    def _give_foreign_rewards(self) -> None:
        """The reward of the step by a foreign potential; where the estimate is not sound, that keeps its value."""
        for i in np.flatnonzero(self._orders != REST).tolist():
            episode = self._runs.episode[i]
            before = float(episode.potential[FOREIGN])
            if episode.sound:
                where = f"after {episode.steps} steps of environment {i}"
                what, evaluation = f"reward {self.setting.reward!r}", episode.evaluation.copy()
                episode.potential[FOREIGN] = number_from(what, self.setting.potential, evaluation, where=where)
            if self._orders[i] == STEP:
                episode.gains[FOREIGN] = episode.potential[FOREIGN] - before
                uncompiled(give_reward)(row(self._runs, i), FOREIGN)

    def _at(self, i: int) -> Run:
        """Run ``i``, with its whole estimate."""
        complete(self._runs, i, i + 1)
        return row(self._runs, i)

    def _each(self) -> list[Run]:
        return [self._at(i) for i in range(len(self._runs.episode))]

    def _scenes(self) -> tuple[Scene, ...]:
        """The scene of each run."""
        foreign = [getattr(perception, "scene", None) for perception in self._perceptions]
        return tuple(scene or box_scene(row(self._runs, i)) for i, scene in enumerate(foreign))

    def _given(self, batch: np.ndarray) -> Any:
        """``batch`` (B, ...) as readers get it: with a leading axis of a batch, without one of a single environment."""
        if not self._single:
            return batch
        return batch[0] if batch.ndim > 1 else batch[0].item()

    @property
    def motion_phase(self) -> Any:
        """Steps since the present motion period began; the next step's motion is read where this is 0."""
        return self._given(self._runs.episode["steps"] % self.steps_per_motion)

    @property
    def time(self) -> Any:
        """Time since the reset [s]."""
        return self._given(self._runs.episode["steps"] * self.gaze_period)

    def action_masks(self) -> np.ndarray:
        """(10,) bool, motions and then gazes (discrete: (21,)): false for a motion that the next step would ignore.

        Where a motion is not read, only the one under way is true. Sb3-contrib's `MaskablePPO` asks for it.

        Raises:
            AttributeError: the actions are continuous.
        """
        if not self._encoding.whole:
            raise AttributeError("continuous actions have no masks")
        episode = self._runs.episode
        reads = episode["steps"] % self.steps_per_motion == 0
        under_way = np.array([nearest_motion(command) for command in episode["control"]["command"]])
        motions = reads[:, None] | (np.arange(MOTION_COUNT) == under_way[:, None])
        if self._encoding is INDICES:
            return self._given(np.repeat(motions, GAZE_COUNT, axis=1))
        return self._given(np.hstack((motions, np.ones((len(motions), GAZE_COUNT), bool))))

    @property
    def context(self) -> Any:
        """What a policy for several scenarios needs beside the observation; `CONTEXT_FEATURES`."""
        return self._given(context_of(self._runs, self.duration))

    @property
    def landmark_errors(self) -> np.ndarray:
        """(L,) distance of each true landmark from its mapped feature [m]; NaN where it is not. For the evaluator."""
        each = [landmark_errors(run.owner, run.world.landmarks, run.estimate) for run in self._each()]
        return self._given(np.stack(each))
