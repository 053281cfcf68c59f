"""Does each RL library learn in the environment? Each script of `examples/`, in the environment of `make clients`.

    python -m studies.clients --report docs/clients.md

Prints the mean return in bits before and after training, and the time. Skips libraries that are not installed;
``--report`` needs them all, and `make client-figures` installs them.
"""

import os
import re
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import tyro

from agents.tools.sections import page_with, table
from studies import publish, run

ROOT = Path(__file__).resolve().parents[1]
HEADER = ("Client", "Script", "Steps", "Before → after [bit]", "Time [s]")
LINE = re.compile(r": (-?\d+) -> (-?\d+) bits, (\d+) steps in (\d+) s$", re.MULTILINE)
"""The last line of each script's output."""


class Client(NamedTuple):
    """How a library is run."""

    environment: str
    """Folder under .venvs."""
    package: str
    """The package whose version the table shows."""
    description: str
    script: str
    """In examples/."""
    arguments: tuple[str, ...] = ()


CLIENTS = (
    Client("sb3", "stable-baselines3", "PPO on the batch `ActiveSLAMVecEnv`", "sb3.py", ("PPO",)),
    Client("sb3", "stable-baselines3", "A2C on `make_vec_env`", "sb3.py", ("A2C",)),
    Client("sb3", "stable-baselines3", "DQN on `make_vec_env`, 21 actions", "sb3.py", ("DQN",)),
    Client("sb3", "sb3-contrib", "RecurrentPPO on the batch", "sb3.py", ("RecurrentPPO",)),
    Client("sb3", "sb3-contrib", "MaskablePPO on the batch", "sb3.py", ("MaskablePPO",)),
    Client("sb3", "rl_zoo3", "PPO from [ppo.yml](../examples/rl_zoo3/ppo.yml)", "rl_zoo3/train.py"),
    Client("torchrl", "torchrl", "its PPO loss on `GymEnv`", "torchrl_ppo.py"),
    Client("rllib", "ray", "RLlib's PPO (new API stack), two workers", "rllib_ppo.py"),
    Client("cleanrl", "cleanrl", "`ppo.py`, 21 actions", "cleanrl_ppo.py"),
)


def python_of(client: Client) -> Path:
    """The interpreter of a client's environment."""
    return ROOT / ".venvs" / client.environment / "bin" / "python"


def version_of(client: Client) -> str:
    """The installed version of its package."""
    code = f"from importlib.metadata import version; print(version({client.package!r}))"
    return subprocess.run([python_of(client), "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def trained(client: Client) -> list[int]:
    """Run its script: before and after [bit], steps, seconds. Raises ValueError where it fails."""
    command = [str(python_of(client)), str(ROOT / "examples" / client.script), *client.arguments]
    one_thread = {**os.environ, "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(command, cwd=folder, env=one_thread, capture_output=True, text=True)
    found = LINE.search(done.stdout)
    if done.returncode or not found:
        raise ValueError(f"{client.script} ended with {done.returncode}: {done.stdout[-200:]} {done.stderr[-500:]}")
    return [int(one) for one in found.groups()]


def row_of(client: Client) -> list[str]:
    """Its row of the table."""
    before, after, steps, seconds = trained(client)
    script = " ".join((f"[{client.script}](../examples/{client.script})", *(f"`{one}`" for one in client.arguments)))
    name = f"{client.package} {version_of(client)}, {client.description}"
    row = [name, script, f"{steps:,}".replace(",", " "), f"{before} → {after}", str(seconds)]
    print(", ".join(row), flush=True)
    return row


def main(report: Path | None = None) -> None:
    """Run each client of the examples, and print a table.

    Args:
        report: A page whose generated section "clients" is made; for it all must be installed.
    """
    missing = sorted({client.environment for client in CLIENTS if not python_of(client).exists()})
    if report:
        page_with(report, "clients")
    if report and missing:
        raise ValueError(f"--report: not installed: {', '.join(missing)}; make client-figures installs them")
    rows = [row_of(client) for client in CLIENTS if client.environment not in missing]
    publish(report, "clients", table(HEADER, rows), "make client-figures")


if __name__ == "__main__":
    run(lambda: tyro.cli(main, prog="python -m studies.clients"))
