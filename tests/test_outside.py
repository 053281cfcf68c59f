"""What policies read of a run without an environment is what they would read of an environment in the same state."""

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym
import baselines
from activeslam_gym import observation_layout
from activeslam_gym.config import SCENARIOS
from activeslam_gym.envs.outside import OutsideRun
from activeslam_gym.information.sensor_limits import UNLIMITED


@pytest.mark.parametrize("name", ["hand-held", "paper"])
def test_the_observation_is_that_of_an_environment(name: str) -> None:
    env = gym.make("ActiveSLAM-v0", scenario=name, gaze_period=1.0)
    env.reset(seed=5)
    outside, layout = OutsideRun(SCENARIOS[name], 1.0, UNLIMITED), observation_layout(env)
    assert observation_layout(outside) == layout and activeslam_gym.core_of(outside) is outside
    for action in [(2, 2), (4, 0), (0, 1), (6, 1)]:
        observation, *_ = env.step(action)
        outside.decided(action)
        run, tokens = env.unwrapped._run, layout.tokens
        n = int(run.estimate.state.count)
        seen = outside.observed(
            run.estimate, np.zeros((n, 3)), run.expected, run.world.fiducials, float(run.episode.gain)
        )
        np.testing.assert_array_equal(seen[: tokens.start], observation[: tokens.start])
        sets = (np.unique(part[tokens].reshape(layout.token_shape), axis=0) for part in (seen, observation))
        np.testing.assert_array_equal(*sets)  # a feature may have another slot
    assert n > 5
    np.testing.assert_allclose(outside.motion_scores(), env.unwrapped.motion_scores(), rtol=1e-12)
    policies = [baselines.make("mi-mi", one) for one in (outside, env)]
    ours, theirs = (policy.predict(observation)[0] for policy in policies)
    np.testing.assert_array_equal(ours, theirs)
