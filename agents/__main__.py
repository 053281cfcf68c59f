"""`python -m agents <command>`: tyro makes the command lines from the commands' dataclasses."""

import sys
from collections.abc import Callable, Sequence
from importlib import import_module

PROGRAM = "python -m agents"
COMMANDS = {
    "compare": "agents.compare",
    "enter": "agents.suite.enter",
    "export": "agents.export",
    "leaderboard": "agents.suite.leaderboard",
    "train": "agents.train",
    "verify": "agents.suite.verify",
    "watch": "agents.watch",
}
"""Name → module with `Args`, a dataclass, and `main(args) -> exit status`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that the arguments name; the exit status, 2 for a mistake, which is told in a line.

    A mistake is a bad argument, file or folder, a full disk, or a missing package or screen. Ctrl-C is 130.
    """
    name = PROGRAM
    try:
        import gymnasium
        import tyro

        from agents.learn.recipe import expanded

        modules = {name: import_module(module) for name, module in COMMANDS.items()}
        commands: dict[str, Callable] = {name: module.Args for name, module in modules.items()}
        given = expanded(sys.argv[1:] if arguments is None else arguments)
        args = tyro.extras.subcommand_cli_from_dict(commands, prog=PROGRAM, args=given)
        name, module = next((name, module) for name, module in modules.items() if isinstance(args, module.Args))
        try:
            return module.main(args)
        except SystemExit as error:  # of a user's scenario, scene or other part
            raise ValueError(f"code that it loaded ended it: SystemExit: {error}") from error
    except KeyboardInterrupt:
        return 130
    except ModuleNotFoundError as error:
        ours = error.name in ("stable_baselines3", "tensorboard", "torch")  # not a module of a user's own
        hint = f"make demo installs all into .venv, or: pip install --editable '.[{'agents' if ours else 'compare'}]'"
        return _mistake(name, f"{sys.executable} lacks {error.name}; {hint}" if ours or name == PROGRAM else str(error))
    except ImportError as error:
        return _mistake(name, str(error))
    except (ValueError, OSError, MemoryError, gymnasium.error.Error) as error:
        return _mistake(name, str(error) or type(error).__name__)


def _mistake(name: str, message: str) -> int:
    line = " ".join(message.split())  # PyTorch has messages of several
    print(f"{name if name == PROGRAM else f'{PROGRAM} {name}'}: {line}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
