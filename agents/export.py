"""`python -m agents export`: learned weights as a file that Stable-Baselines3 or an ONNX runtime loads."""

import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from activeslam_gym.files import written_whole
from agents import pretrained
from agents.tools.files import json_text, writable_file


@dataclass(frozen=True)
class Args:
    """Write learned weights as a .zip for `PPO.load` (or A2C, DQN, SAC), to be trained on or used with SB3's own tools;
    or as an .onnx file, the network alone, for programs without PyTorch."""

    policy: str = "ppo"
    """Shipped weights by their name, or a file of weights (policy.npz)."""
    out: Path = Path("results/export/ppo.zip")
    """The file."""


def main(args: Args) -> int:
    """Run the command; the exit status. Raises ValueError for absent or damaged weights, or a file that cannot be."""
    from agents.learn.algorithms import learner_of
    from agents.learn.weights import read

    if args.out.suffix not in (".zip", ".onnx"):
        raise ValueError(f"out must end in .zip or .onnx, got {str(args.out)!r}")
    writable_file("out", args.out)
    if (path := pretrained.path_of(args.policy)) is None:
        shipped = ", ".join(pretrained.names())
        raise ValueError(f"policy: {args.policy!r} has no weights; allowed: {shipped}, a file (policy.npz)")
    weights, card = read(path.stem, path.parent)
    learner, period = learner_of(weights, card), card["decision_period"]
    if args.out.suffix == ".onnx":
        size = write_onnx(learner.policy, card, args.out)
        action = "the output" if card["algorithm"] == "sac" else "the greatest output"
        print(f"Written to {args.out}: `input` (B, {size}) every {period} s; {action} is the action")
        return 0
    with written_whole(args.out) as unfinished:
        learner.save(unfinished)
    name = str(card["algorithm"]).upper()
    print(f"Written to {args.out}: {name}.load({str(args.out)!r}), for environments with gaze_period={period}")
    return 0


def write_onnx(network: Any, card: dict[str, Any], out: Path) -> int:
    """Write the part of SB3's policy ``network`` that decides, with its card; the numbers of an input.

    Raises ValueError where the packages for it are absent.
    """
    import torch

    from agents.learn.weights import Actor

    try:
        import onnx
        import onnxscript  # noqa: F401  (what PyTorch writes with)
    except ImportError as error:
        raise ValueError(f"out: {str(out)!r} needs the extra `onnx` ({error}); allowed: a .zip") from error
    example = torch.zeros(2, *network.observation_space.shape)
    names = {"dqn": ["value"], "sac": ["action"]}.get(card["algorithm"], ["motion", "gaze"])
    batch = {"observations": {0: torch.export.Dim("batch")}}
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # of what is not needed and not there
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # PyTorch's own
        program = torch.onnx.export(
            Actor(network).eval(), (example,), input_names=["input"], output_names=names,
            dynamic_shapes=batch, dynamo=True, verbose=False,
        )  # fmt: skip
    model = program.model_proto
    onnx.helper.set_model_props(model, {"card": json_text(card)})
    with written_whole(out) as unfinished:
        unfinished.write_bytes(model.SerializeToString())
    return example.shape[1]
