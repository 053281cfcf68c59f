"""Where the microseconds of a frame go: each kernel alone, on the arrays of a run in the middle of a sweep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from activeslam_gym.envs.frame import filter_entries
from activeslam_gym.envs.scoring import find_mapped
from activeslam_gym.envs.step import advance_runs, entries_of, evaluate_runs
from activeslam_gym.information import gathered, update_expectation
from activeslam_gym.linalg import cholesky_in_place
from activeslam_gym.slam.association import associate
from activeslam_gym.slam.belief import DIM, FEATURES, FRAME, point_belief
from activeslam_gym.slam.initialisation import follow_candidates
from activeslam_gym.slam.measurement import UNSEEN, predict_measurements
from activeslam_gym.slam.prediction import predict
from activeslam_gym.slam.update import innovation_covariance, stack, update
from activeslam_gym.world.simulator import detect, move

from .report import Section
from .setups import copied, restore, swept
from .timing import dispatch, restored


class Stages:
    """Kernels with arguments as a frame hands them on, and the way back to before the frame."""

    def __init__(self) -> None:
        self.env, _ = swept(0)
        inner: Any = self.env.unwrapped
        self.setting, self.runs, run = inner.setting, inner._runs, inner._run
        self.simulation = run.simulation
        self.saved_runs = copied(self.runs)
        self.whole, self.frame, self.worth = self._wholes(), self._frame_kernels(), self._worth_kernels()

    def _wholes(self) -> dict[str, tuple[Callable, tuple]]:
        models, task, runs = self.setting.models, self.setting.task, self.runs
        motions, gazes = np.array([2]), np.array([1])
        filtering = filter_entries(with_rays=False)
        advance_with = (models, task, runs.simulation, runs.step.status, motions, gazes, 0, 1, filtering)
        entries = entries_of(models, task, runs, motions, gazes, filtering)
        self.step_with = (models, task, runs, motions, gazes, 0, 1, entries)
        return {
            "the frame (`advance_runs`)": (advance_runs, advance_with),
            "its worth (`evaluate_runs`)": (evaluate_runs, (models, task, runs, motions, 0, 1)),
        }

    def _frame_kernels(self) -> dict[str, tuple[Callable, tuple]]:
        """The frame's own kernels; each is prepared by running those before it."""
        models, s, belief = self.setting.models, self.simulation, self.simulation.belief
        camera, frame, u = models.camera, int(belief.size[FRAME]), np.zeros(6)
        fiducials = s.world.points[: s.world.points.shape[0] - s.expectation.points.shape[0]]
        K = fiducials.shape[0]
        move_with, detect_with = (
            (models.motion, s.world, u, frame),
            (camera, models.sensor, s.world, frame, s.detections),
        )
        move(*move_with)
        detect(*detect_with)
        pixels = s.detections.pixels[: s.detections.used[0]].copy()
        predict(models.motion, belief, u)
        predictions = predict_measurements(camera, belief, fiducials)
        rows = np.flatnonzero(predictions.visibility != UNSEEN)
        HP = stack(belief, K, rows, predictions)
        S_with = (belief, K, rows, predictions, HP, camera.pixel_std**2)
        S = innovation_covariance(*S_with)
        waits = np.zeros(predictions.visibility.shape[0], bool)
        match_with = (models.filter, rows, predictions, S, pixels, waits)
        match = associate(*match_with)
        kept = np.flatnonzero(np.repeat(np.isin(rows, match), 2))
        self.HP, self.S = HP[kept], S[np.ix_(kept, kept)]
        self.features, self.matches, self.rows = int(belief.size[FEATURES]), len(kept) // 2, int(belief.size[DIM])
        self.work = self.HP.copy(), self.S.copy()
        self.restore()
        return {
            "true motion": (move, move_with),
            "detection": (detect, detect_with),
            "prediction": (predict, (models.motion, belief, u)),
            "predicted pixels": (predict_measurements, (camera, belief, fiducials)),
            "H P": (stack, (belief, K, rows, predictions)),
            "S": (innovation_covariance, S_with),
            "association": (associate, match_with),
            "update": (update, (belief, *self.work, np.zeros(len(kept)))),
            "births": (follow_candidates, (camera, models.filter, belief, pixels, match)),
            "expected landmarks": (update_expectation, (s.expectation, belief)),
        }

    def _worth_kernels(self) -> dict[str, tuple[Callable, tuple]]:
        """The kernels of what the frame is worth; scores against the truth and the observation are in the rest."""
        s, n = self.simulation, self.features
        belief, order, none = s.belief, np.arange(n), np.zeros(0, np.int64)
        point_belief(belief, s.points, s.covariance)
        self.public = gathered(s.covariance, none, order)
        self.factor = self.public.copy()
        return {
            "public belief": (point_belief, (belief, s.points, s.covariance)),
            "gathering": (gathered, (s.covariance, none, order)),
            "factor of the public covariance": (cholesky_in_place, (self.factor,)),
            "mapped": (find_mapped, (belief, self.setting.task.mapped_depth_ratio, s.mapped)),
        }

    def restore(self) -> None:
        """All arrays as they were before the frame."""
        restore(self.runs, self.saved_runs)
        for work, saved in zip(self.work, (self.HP, self.S), strict=True):
            np.copyto(work, saved)
        if hasattr(self, "factor"):
            np.copyto(self.factor, self.public)


def run(quick: bool) -> Section:
    """The table of stages, with what no stage accounts for."""
    section = Section("Where the microseconds of a frame go")
    stages, count = Stages(), 100 if quick else 1000

    def handing_over(kernel: Callable, arguments: tuple) -> float:
        stages.restore()
        return 1e6 * dispatch(arguments, kernel(*arguments), count)

    def cost(kernel: Callable, arguments: tuple) -> float:
        timing = restored(lambda: kernel(*arguments), stages.restore, count)
        return max(0.0, 1e6 * timing.seconds - handing_over(kernel, arguments))

    frame, worth_of_it = (cost(*stage) for stage in stages.whole.values())
    whole = frame + worth_of_it
    rows: dict[str, float] = {"a step of one frame": whole, **dict(zip(stages.whole, (frame, worth_of_it)))}
    rows["handing over the arrays of a run, besides"] = 1e6 * dispatch(stages.step_with, None, count)
    parts = {name: cost(*stage) for name, stage in stages.frame.items()}
    worth = {name: cost(*stage) for name, stage in stages.worth.items()}
    rows |= {f"frame: {name}": value for name, value in parts.items()}
    rows["frame: everything else"] = frame - sum(parts.values())
    rows |= {f"worth: {name}": value for name, value in worth.items()}
    rows["worth: values, rewards, observation"] = worth_of_it - sum(worth.values())
    section.rows = [{"stage": name, "time [µs]": value, "share": value / whole} for name, value in rows.items()]
    section.notes.append(
        f"One frame after 20 s of `sweep`: {stages.features} features, {stages.rows} covariance rows, "
        f"{stages.matches} matches. Each kernel is called from Python {count} times, every time on the same arrays put "
        "back by a copy; from the median is taken that of an empty compiled function of the same arguments and result. "
        "Kernels that the compiler merges in a real frame stand apart here, so the differences (*everything else*, "
        "*values*) carry the errors of the others."
    )
    stages.env.close()
    return section
