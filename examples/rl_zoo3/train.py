"""rl_zoo3's train on ppo.yml, a2c.yml, …: python examples/rl_zoo3/train.py [steps [folder [algorithm [seed]]]].

All that it does is this command, and to read what was written of the evaluations:
python -m rl_zoo3.train --algo ppo --env ActiveSLAM-v0 --gym-packages activeslam_gym --conf-file ppo.yml
"""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HOME = Path(__file__).parent
OF_INTEGERS = ("dqn", "qrdqn")
"""Algorithms that know discrete actions alone."""


def main(
    steps: int = 89_600,
    folder: str = "runs/rl_zoo3",
    algorithm: str = "ppo",
    seed: int = 0,
    num_envs: int | None = None,
) -> tuple[float, float]:
    """Train for `steps` decisions; the mean return [bit] of the first and of the last of ten evaluations.

    num_envs: environments in the batch, where not as many as the file tells.
    """
    name = "ActiveSLAMDiscrete-v0" if algorithm in OF_INTEGERS else "ActiveSLAM-v0"
    options = {
        "algo": algorithm,
        "env": name,
        "gym-packages": "activeslam_gym",
        "conf-file": HOME / f"{algorithm}.yml",
        "n-timesteps": steps,
        "eval-freq": max(steps // 10, 1),
        "eval-episodes": 16,
        "n-eval-envs": 16,
        "log-folder": folder,
        "device": "cpu",
        "seed": seed,
        "verbose": 0,
    } | ({"hyperparams": f"n_envs:{num_envs}"} if num_envs else {})
    arguments = [text for name, value in options.items() for text in (f"--{name}", str(value))]
    began = time.monotonic()
    subprocess.run([sys.executable, "-m", "rl_zoo3.train", *arguments], check=True, stdout=subprocess.DEVNULL)
    newest = max(Path(folder).glob(f"{algorithm}/{name}_*/evaluations.npz"), key=lambda path: path.stat().st_mtime)
    returns = np.load(newest)["results"].mean(axis=1)
    who, seconds = f"rl_zoo3 {algorithm.upper()}, seed {seed}", time.monotonic() - began
    print(f"{who}: {returns[0]:.0f} -> {returns[-1]:.0f} bits, {steps} steps in {seconds:.0f} s")
    return float(returns[0]), float(returns[-1])


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]), *sys.argv[2:4], *map(int, sys.argv[4:5]))  # type: ignore[arg-type]
