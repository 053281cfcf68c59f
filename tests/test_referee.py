"""Votes: whose detections a feature is made of, and which matches were wrong."""

from collections import Counter

import numpy as np
import pytest

from activeslam_gym.envs.referee import NOBODY, OWNER, features_of_landmarks, owners_of, vote
from activeslam_gym.slam.association import NEW, REJECTED
from activeslam_gym.slam.belief import POINT, fiducial_id
from activeslam_gym.slam.filter import candidates_of
from activeslam_gym.slam.map import append_feature, remove_feature
from activeslam_gym.world.simulator import CLUTTER_LABEL

from .support import PAPER, random_belief

K, L = 2, 3


class Referee:
    """Votes on three features, with the ids 1 to 3."""

    def __init__(self) -> None:
        self.belief = random_belief(PAPER, [POINT] * 3, np.random.default_rng(0))
        slots = len(self.belief.feature)
        self.owner, self.votes = np.zeros(slots, OWNER), np.zeros((slots, K + L + 1), np.int64)

    def frame(self, *matches: tuple[int, int]) -> int:
        """Wrong matches of a frame of (match, label)."""
        candidates, labels = candidates_of(np.zeros((len(matches), 2))), np.array([m[1] for m in matches], np.int64)
        candidates["match"] = [m[0] for m in matches]
        return vote(self.owner, self.votes, self.belief, K, candidates, labels)

    @property
    def owners(self) -> list[int]:
        return owners_of(self.owner, self.belief).tolist()


@pytest.mark.parametrize("label, wrong", [(1, 0), (0, 1), (CLUTTER_LABEL, 1)])
def test_a_fiducial_is_itself_and_what_is_not_matched_is_not_wrong(label: int, wrong: int) -> None:
    referee = Referee()
    assert referee.frame((fiducial_id(1), label)) == wrong
    assert referee.frame((NEW, 0)) == referee.frame((REJECTED, 0)) == referee.frame((99, 0)) == 0
    assert referee.owners == [NOBODY] * 3 and not referee.votes.any()


def test_a_feature_is_owned_by_the_landmark_of_more_than_half_of_its_detections() -> None:
    referee, rng, cast = Referee(), np.random.default_rng(1), [Counter() for _ in range(3)]
    for _ in range(40):
        ballots = [(k + 1, int(rng.choice([CLUTTER_LABEL, 0, K, K + k, K + k]))) for k in range(3)]
        wrong, expected = referee.frame(*ballots), 0
        for (_, label), counter in zip(ballots, cast, strict=True):
            counter[label] += 1
            expected += counter[label] < max(counter.values())
        assert wrong >= expected  # a tie goes to one of the two
        for owner, counter in zip(referee.owners, cast, strict=True):
            label, votes = counter.most_common(1)[0]
            owned = label >= K and 2 * votes > sum(counter.values())
            assert owner == (label - K if owned else NOBODY)


def test_a_slots_next_feature_has_no_votes_and_the_oldest_stands_for_its_landmark() -> None:
    referee = Referee()
    for _ in range(3):
        assert referee.frame((1, K + 2)) == 0
    assert referee.owners == [2, NOBODY, NOBODY]
    remove_feature(referee.belief, 0)
    append_feature(referee.belief, POINT, np.zeros(6), np.zeros((3, 12)), np.eye(3))
    assert referee.frame((4, K)) == 0
    assert referee.owners == [NOBODY, NOBODY, 0]
    owners, everyone = np.array([1, NOBODY, 1, 0]), np.ones(4, bool)
    assert features_of_landmarks(owners, L, everyone).tolist() == [3, 0, -1]
    assert features_of_landmarks(owners, L, np.array([False, True, True, True])).tolist() == [3, 2, -1]
