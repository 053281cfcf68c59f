"""`python -m agents train`: PPO, A2C, DQN or SAC from Stable-Baselines3 on the native batch."""

import json
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import Any

from activeslam_gym import BEHAVIOUR
from activeslam_gym.config import fields_of
from agents.learn.recipe import CHECKPOINT, CURVE, WEIGHTS, Args, scenario_of
from agents.tools.files import alone_in, reading, writable_folder, write_json

ARGUMENTS = "arguments.json"


def main(args: Args) -> int:
    """Run the command; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    finished = train(args)
    if not finished:
        print("Interrupted; the same command resumes it.")
    files = f"{WEIGHTS} and its card, {CURVE} of validation, {CHECKPOINT}"
    print(f"Written to {args.out}/: {files}, logs (tensorboard --logdir {args.out}/logs)")
    return 0 if finished else 130


def train(args: Args) -> bool:
    """Train until `total_steps`, or Ctrl-C (then False). A second call goes on from the checkpoint.

    Nothing is written before all arguments are checked.

    Raises:
        ValueError: as `Args.check` and `check_test`, a damaged checkpoint, a folder that holds a training with other
            arguments or one that goes on, or weights that are no longer finite.
    """
    from agents.learn import learner as learners
    from agents.learn.best_weights import BestWeights, check_test
    from agents.sb3 import EpisodeLog

    args.check()
    learners.require_device(args.device)
    if args.initial:
        args = replace(args, width=learners.initial_weights(args)[1]["width"])
    check_test(args)
    env = learners.make_training(args)
    batches = learners.make_validation(args, args.validation_episodes)
    writable_folder("out", args.out)
    with alone_in(args.out), ExitStack() as stack:
        for batch in (env, *batches.values()):
            stack.enter_context(closing(batch))
        _require_same(args)
        learner = learners.learner_in(args, env, args.out / CHECKPOINT, args.out / "logs", args.device)
        write_json(args.out / ARGUMENTS, _identity(args))
        best_weights = BestWeights(args, learner, batches)
        try:
            left = max(args.total_steps - learner.num_timesteps, 0)
            if left or best_weights.visited < learner.num_timesteps:  # the last validation was interrupted
                callbacks = [best_weights, EpisodeLog(), *_wandb(args, stack)]
                learner.learn(left, callback=callbacks, reset_num_timesteps=False, tb_log_name="run")
            finished = True
        except KeyboardInterrupt:
            finished = False
        finally:
            best_weights.close()
        if finished:
            best_weights.complete_card()
        return finished


def _wandb(args: Args, stack: ExitStack) -> list[Any]:
    """The callback of Weights & Biases, where `wandb` names a project; its run ends with the ``stack``."""
    if not args.wandb:
        return []
    import wandb
    from wandb.integration.sb3 import WandbCallback

    stack.enter_context(
        wandb.init(project=args.wandb, config=args.arguments(), dir=args.out, name=args.out.name, sync_tensorboard=True)
    )
    return [WandbCallback()]


def _require_same(args: Args) -> None:
    """Raise ValueError where the folder holds another training; `total_steps` alone may differ."""
    path, wanted = args.out / ARGUMENTS, _identity(args)
    with reading(path):
        held = dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else wanted
    for name, value in wanted.items():
        if name != "total_steps" and held.get(name, value) != value:  # an older training may not name it
            raise ValueError(
                f"out: {args.out} holds a training with {name}={held[name]!r:.80}, got {value!r:.80}; "
                "allowed: the same arguments, or another folder"
            )


def _identity(args: Args) -> dict[str, Any]:
    """What makes a training, JSON-plain: its arguments, the fields of its scenarios, and `BEHAVIOUR`."""
    fields = [fields_of(scenario_of(name)) for name in args.scenarios]
    plain: dict[str, Any] = json.loads(json.dumps(args.arguments() | {"behaviour": BEHAVIOUR, "scenarios": fields}))
    return plain
