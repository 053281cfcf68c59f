"""`python -m agents <command>`: tyro makes the command lines from the commands' dataclasses."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib import import_module

import gymnasium

COMMANDS = {
    "compare": "agents.compare.command",
    "consistency": "agents.honesty.command",
    "generalise": "agents.compare.generalise",
    "study": "agents.study.command",
    "train": "agents.train",
    "watch": "agents.watching.command",
}
"""Name → module with `Args`, a dataclass, and `main(args) -> exit status`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that the arguments name; the exit status, 2 for a bad argument or a missing package or screen.

    Ctrl-C is 130.
    """
    try:
        import tyro
    except ModuleNotFoundError:
        hint = (
            f"{sys.executable} lacks tyro; make demo installs all into .venv, or: pip install --editable '.[compare]'"
        )
        print(f"python -m agents: {hint}", file=sys.stderr)
        return 2
    modules = {name: import_module(module) for name, module in COMMANDS.items()}
    commands: dict[str, Callable] = {name: module.Args for name, module in modules.items()}
    try:
        args = tyro.extras.subcommand_cli_from_dict(commands, prog="python -m agents", args=arguments)
    except ValueError as error:
        print(f"python -m agents: {error}", file=sys.stderr)
        return 2
    name, module = next((name, module) for name, module in modules.items() if isinstance(args, module.Args))
    try:
        return module.main(args)
    except KeyboardInterrupt:
        return 130
    except (ValueError, ImportError, gymnasium.error.Error) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
