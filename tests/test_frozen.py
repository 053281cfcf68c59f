"""The behaviour of the environments is frozen: the same seed and actions give the recorded run.

The actions are fixed, not a policy's, so that a difference is not fed back; and the runs are short. The filter deletes
a small difference as it is corrected by measurements, unless the difference decides a match: what another processor
rounds otherwise stays near 1e-11 for seconds (`test_rounding_decides_nothing`), far under the tolerances here.
"""

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym
from tests.record_frozen import CASES, FOLDER, IMAGES, POINTS, play
from tests.support import simulation_of

TIGHT, LOOSE = 1e-7, 1e-5
"""Tolerance of the first two seconds, and of the others: relative, and absolute."""

MEANING = """{env_id} no longer does what it did: {what} of '{case}' differs first at moment {moment}
(recorded {recorded}, now {now}). If that is not meant, the change is at fault, or a new release of NumPy draws other
numbers from the same seed. If it is, see "Versions" in CONTRIBUTING.md, and train the shipped weights again."""


@pytest.mark.parametrize("case", CASES)
def test_v0_does_what_it_did(case: str) -> None:
    env_id, *_, gaze_period = CASES[case]
    if env_id == IMAGES:
        pytest.importorskip("cv2")
    now = play(case)
    with np.load(FOLDER / f"{env_id}-{case}.npz") as file:
        recorded = dict(file)
    assert recorded.pop("behaviour") == activeslam_gym.BEHAVIOUR, "raise BEHAVIOUR, and then record"
    missing = sorted(recorded.keys() - now.keys())  # a new key of info changes nothing
    assert not missing, f"{env_id} no longer tells {', '.join(missing)}: that needs a new id, see CONTRIBUTING.md"
    for what, then in recorded.items():
        assert then.shape == now[what].shape, f"'{case}': {what} was of shape {then.shape}, is {now[what].shape}"
        period = (len(recorded["reward"]) - 1) / (len(then) - 1)  # steps between two of these moments
        moments = np.arange(len(then)) * period * gaze_period
        early = (moments <= 2.0).reshape(-1, *(1,) * (then.ndim - 1))
        tight, loose = (np.isclose(now[what], then, rtol=tolerance, atol=tolerance) for tolerance in (TIGHT, LOOSE))
        same = np.where(early, tight, loose)
        if not same.all():
            at = tuple(np.argwhere(~same)[0])
            at_fault = {"env_id": env_id, "what": what, "case": case, "moment": at[0]}
            pytest.fail(MEANING.format(**at_fault, recorded=then[at], now=now[what][at]))


class Nudged(gym.Wrapper):
    """An environment whose first estimate is off by ``nudge`` (3,) [m]."""

    nudge: tuple[float, float, float]

    def reset(self, **kwargs):
        out = super().reset(**kwargs)
        simulation_of(self).ekf.state.camera[:3] += self.nudge
        return out


@pytest.mark.parametrize(
    ("scenario", "seed"), [("paper", 8), ("paper-literal", 4), ("paper-literal", 6), ("clutter", 8)]
)
def test_rounding_decides_nothing(scenario: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal pairings in the association were once decided by their last digit: these runs parted within seconds."""
    monkeypatch.setitem(CASES, "nudged", (POINTS, scenario, seed, 0.25))
    plain, make = play("nudged"), gym.make
    monkeypatch.setattr(gym, "make", lambda *args, **kwargs: Nudged(make(*args, **kwargs)))
    for nudge in ((1e-13, -1e-13, 1e-13), (-1e-13, 1e-13, 5e-14)):
        monkeypatch.setattr(Nudged, "nudge", nudge, raising=False)
        nudged = play("nudged")
        for what, then in plain.items():
            np.testing.assert_allclose(nudged[what], then, rtol=1e-8, atol=1e-8, err_msg=what)
