"""Counter-based noise: draw c of a stream is a function of (key, c) alone.

So the noise of frame k does not depend on how many numbers a policy's past consumed, and needs no state. The generator
is SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014), whose output c is
mix(key + c * gamma); normals by Box and Muller.
"""

import math

import numpy as np

from activeslam_gym.kernels import compiled

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)


@compiled
def uniforms(key: np.ndarray, first: int, count: int) -> np.ndarray:
    """Draws ``first`` … ``first + count - 1`` of the stream ``key`` ((1,) uint64): uniform in (0, 1), (count,)."""
    bits = np.arange(first + 1, first + count + 1).astype(np.uint64)  # whole arrays: their products wrap in silence
    bits = bits * _GAMMA + key
    bits = (bits ^ (bits >> _S30)) * _MIX_1
    bits = (bits ^ (bits >> _S27)) * _MIX_2
    bits = (bits ^ (bits >> _S31)) >> _S11
    return (bits.astype(np.float64) + 0.5) * 2.0**-53


@compiled
def normals(key: np.ndarray, first: int, count: int) -> np.ndarray:
    """Standard normal draws (count,) of the stream ``key``; ``first`` and ``count`` even, so that pairs stay whole."""
    u = uniforms(key, first, count)
    out = np.empty(count)
    for i in range(0, count, 2):
        out[i], out[i + 1] = normal_pair(u[i], u[i + 1])
    return out


@compiled
def normal_pair(u: float, v: float) -> tuple[float, float]:
    """Two standard normal numbers from two uniform ones (Box and Muller)."""
    radius = math.sqrt(-2.0 * math.log(u))
    return radius * math.cos(2.0 * math.pi * v), radius * math.sin(2.0 * math.pi * v)
