"""`python -m agents export`: learned weights as a file that Stable-Baselines3 loads."""

from dataclasses import dataclass
from pathlib import Path

from activeslam_gym.files import written_whole
from agents.learn.recipe import Recipe
from agents.learn.weights import read
from agents.tools.files import writable_file


@dataclass(frozen=True)
class Args:
    """Write learned weights as a .zip for `PPO.load` (or A2C, DQN, SAC), to train on or to use with SB3's tools."""

    policy: str = "ppo"
    """Weights: a shipped policy's name, or a file (policy.npz)."""
    out: Path = Path("results/export/ppo.zip")
    """File to write, which ends in .zip."""


def main(args: Args) -> int:
    """Run the command; the exit status. Raises ValueError for absent or damaged weights, or a file that cannot be."""
    from agents.learn.learner import learner_of

    if args.out.suffix != ".zip":
        raise ValueError(f"out must end in .zip, got {str(args.out)!r}")
    writable_file("out", args.out)
    weights, card = read(args.policy)
    learner = learner_of(weights, card)
    with written_whole(args.out) as unfinished:
        learner.save(unfinished)
    how = f"{str(card['algorithm']).upper()}.load({str(args.out)!r})"
    several = len(Recipe.of(card).scenarios) > 1 or card.get("initial")
    tokens = learner.policy_kwargs["features_extractor_kwargs"]["layout"].token_shape[0]
    common = f", in the common layout: agents.sb3.SeveralScenarios(batches, tokens={tokens})" if several else ""
    print(f"Written to {args.out}: {how}, for environments with gaze_period={card['decision_period']}{common}")
    return 0
