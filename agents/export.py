"""`python -m agents export`: learned weights as a file that Stable-Baselines3 loads."""

from dataclasses import dataclass
from pathlib import Path

from activeslam_gym.files import written_whole
from agents import pretrained
from agents.tools.files import writable_file


@dataclass(frozen=True)
class Args:
    """Write learned weights as a .zip for `PPO.load` (or A2C, DQN), to be trained on or used with SB3's own tools."""

    policy: str = "ppo"
    """Shipped weights by their name, or a file of weights (policy.npz)."""
    out: Path = Path("results/export/ppo.zip")
    """The file."""


def main(args: Args) -> int:
    """Run the command; the exit status. Raises ValueError for weights that there are not, or a file that cannot be."""
    if args.out.suffix != ".zip":
        raise ValueError(f"out must end in .zip, got {str(args.out)!r}")
    writable_file("out", args.out)
    card = export(args.policy, args.out)
    name, period = str(card["algorithm"]).upper(), card["decision_period"]
    print(f"Written to {args.out}: {name}.load({str(args.out)!r}), for environments with gaze_period={period}")
    return 0


def export(policy: str, out: Path) -> dict:
    """Write the weights that `policy` names to `out`; their card. Raises ValueError where there are none."""
    from agents.learn.algorithms import learner_of
    from agents.learn.weights import read

    path = Path(policy) if policy.endswith(".npz") else pretrained.FOLDER / f"{policy}.npz"
    if not path.is_file():
        shipped = ", ".join(pretrained.names())
        raise ValueError(f"policy: {policy!r} has no weights; allowed: {shipped}, a file (policy.npz)")
    weights, card = read(path.stem, path.parent)
    learner = learner_of(weights, card)
    out.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(out) as unfinished:
        learner.save(unfinished)
    return card
