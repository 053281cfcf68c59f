"""The stress command, small; its whole million of frames is `python -m benchmarks.stress`."""

from typing import Any

import numpy as np
import pytest

from activeslam_gym import SCENARIOS, ActiveSLAMVectorEnv, Scenario
from benchmarks import stress


def test_random_scenarios_are_legal_and_differ() -> None:
    rng = np.random.default_rng(0)
    drawn = [stress.random_scenario(rng) for _ in range(20)]
    assert len(set(drawn)) == 20 and Scenario(name="random") not in drawn


@pytest.mark.slow  # tests/test_env.py flies them too
def test_every_scenario_is_flown_and_a_number_that_is_not_finite_found(
    monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    assert stress.main(["--frames", "160", "--scenarios", "2"]) == 0
    assert f"{len(SCENARIOS) + 2} scenarios" in capsys.readouterr().out
    step = ActiveSLAMVectorEnv.step

    def broken(self: ActiveSLAMVectorEnv, actions: Any) -> Any:
        observation, reward, *rest, infos = step(self, actions)
        infos["reward_terms"]["entropy"][0] = np.nan
        return observation, reward, *rest, infos

    monkeypatch.setattr(ActiveSLAMVectorEnv, "step", broken)
    assert stress.main(["--frames", "20", "--scenarios", "0", "--seed", "7"]) == 1
    out = capsys.readouterr().out
    assert "FAILED, seed 7: ArithmeticError: not finite: entropy" in out and f"{len(SCENARIOS)} failures" in out


@pytest.mark.parametrize("line", ["--frames 0", "--frames -5", "--frames nan", "--scenarios -1", "--seed -1"])
def test_a_number_that_makes_no_sense_is_told_before_any_frame(line: str, capsys: Any) -> None:
    with pytest.raises(SystemExit) as exit_:
        stress.main(line.split())
    told = capsys.readouterr()
    assert exit_.value.code == 2 and line.split()[0] in told.err and not told.out
