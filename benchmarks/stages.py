"""Where the microseconds of a frame go: each kernel alone, on the arrays of a run in the middle of a sweep."""

from collections.abc import Callable
from typing import Any

import numpy as np

from activeslam_gym.envs.episode import STEP, evaluate, observe
from activeslam_gym.envs.run import Run, known_boxes
from activeslam_gym.envs.simulation import advance
from activeslam_gym.information.entropy import gathered
from activeslam_gym.information.expectation import update_expectation
from activeslam_gym.kernels import compiled, row
from activeslam_gym.linalg import cholesky_in_place
from activeslam_gym.motion import COMMANDS, Gaze, Motion
from activeslam_gym.slam.association import associate
from activeslam_gym.slam.belief import write_estimate
from activeslam_gym.slam.frame import update_by
from activeslam_gym.slam.initialisation import follow_tracks
from activeslam_gym.slam.kalman import predict
from activeslam_gym.slam.sight import sight_of_belief
from activeslam_gym.world.simulator import detect, move

from .report import Section
from .setups import copied, restore, swept
from .timing import dispatch, restored


@compiled
def value_of_frames(run: Run) -> None:
    """What a step does after its frames."""
    evaluate(run)
    observe(run)


class Stages:
    """Kernels with arguments as a frame hands them on, and the way back to before the frame."""

    def __init__(self) -> None:
        self.env, _ = swept(0)
        inner: Any = self.env.unwrapped
        self.runs = inner._runs
        self.play_with = self.runs, np.array([STEP]), COMMANDS[Motion.RIGHT, Gaze.LEFT][None], 0, 1
        self.run, self.saved = row(self.runs, 0), copied(self.runs)
        self.whole: dict[str, tuple[Callable, tuple]] = {
            "the frame (`advance`)": (advance, (self.run, 1.0, True)),
            "its worth (`evaluate`, `observe`)": (value_of_frames, (self.run,)),
        }
        self.frame, self.worth = self._frame_kernels(), self._worth_kernels()

    def _frame_kernels(self) -> dict[str, tuple[Callable, tuple]]:
        """The frame's own kernels; each is prepared by running those before it."""
        run, models, world, belief = self.run, self.run.models, self.run.world, self.run.ekf
        camera, motion, u = models.camera, models.motion, np.zeros(6)
        move_with = (motion, world, u)
        detect_with = (models.true_camera, models.sensor, world, run.candidate, run.label)
        predict_with = (motion, belief, u, float(motion.dt))
        sight_with = (camera, belief, world.fiducials, known_boxes(run))
        move(*move_with)
        candidates = run.candidate[: detect(*detect_with)].copy()
        predict(*predict_with)
        sight = sight_of_belief(*sight_with)
        waits = np.zeros(len(sight.thing), bool)
        self.features, self.rows = int(run.estimate.state.count), sight.HP.shape[1]
        match_with = (models.filter.association, sight, candidates, self.features, waits)
        of_thing = associate(*match_with)[0]
        self.matches = int(np.sum(of_thing >= 0))
        update_with = (camera, belief, world.fiducials, sight, of_thing, candidates)
        ratio = float(models.filter.initialisation.mapped_depth_ratio)
        self.restore()
        return {
            "true motion": (move, move_with),
            "detection": (detect, detect_with),
            "prediction": (predict, predict_with),
            "sight: predicted pixels, H P, S": (sight_of_belief, sight_with),
            "association": (associate, match_with),
            "update": (update_by, update_with),
            "births": (follow_tracks, (camera, models.filter.initialisation, belief, candidates)),
            "estimate": (write_estimate, (belief, ratio, run.estimate)),
            "expected landmarks": (update_expectation, (run.expected, models.landmark_var, run.estimate)),
        }

    def _worth_kernels(self) -> dict[str, tuple[Callable, tuple]]:
        """The kernels of what the frame is worth; scores against the truth are in the rest."""
        run, order, none = self.run, np.arange(self.features), np.zeros(0, np.int64)
        covariance = run.estimate.covariance
        self.public = gathered(covariance, none, order)
        self.factor = self.public.copy()
        return {
            "gathering": (gathered, (covariance, none, order)),
            "factor of the public covariance": (cholesky_in_place, (self.factor,)),
            "observation": (observe, (run,)),
        }

    def restore(self) -> None:
        """All arrays as they were before the frame."""
        restore(self.runs, self.saved)
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
    rows["handing over the arrays of a run, besides"] = 1e6 * dispatch(stages.play_with, None, count)
    parts = {name: cost(*stage) for name, stage in stages.frame.items()}
    worth = {name: cost(*stage) for name, stage in stages.worth.items()}
    rows |= {f"frame: {name}": value for name, value in parts.items()}
    rows["frame: everything else"] = frame - sum(parts.values())
    rows |= {f"worth: {name}": value for name, value in worth.items()}
    rows["worth: values and rewards"] = worth_of_it - sum(worth.values())
    section.rows = [{"stage": name, "time [µs]": value, "share": value / whole} for name, value in rows.items()]
    section.notes.append(
        f"One frame after 20 s of `sweep`: {stages.features} features, {stages.rows} covariance rows, "
        f"{stages.matches} matches. Each kernel is called from Python {count} times, every time on the same arrays put "
        "back by a copy; from the median is taken that of an empty compiled function of the same arguments and result. "
        "Kernels that the compiler merges in a real frame stand apart here, so the differences (*everything else*, "
        "*values and rewards*) carry the errors of the others."
    )
    stages.env.close()
    return section
