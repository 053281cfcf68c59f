"""Draws from a belief, for imagined runs: where camera and landmarks may really be."""

import numpy as np

from activeslam_gym.motion import POSITION
from activeslam_gym.slam.belief import ANCHOR, POINT, RAY, Belief, positions_of
from activeslam_gym.slam.manifold import shift_mean


def drawn_from(belief: Belief, half: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A camera (13,) and a point (n, 3) for each feature, drawn from the belief; points stay in the room ``half`` (3,).

    mean ⊞ delta with delta ~ N(0, P); the depth of a ray is that of one of its particles.
    """
    dim, n = int(belief.state.dim), int(belief.state.count)
    drawn = belief._replace(state=belief.state.copy(), feature=belief.feature.copy())
    for k in range(n):
        if drawn.feature[k].kind == RAY:
            depths, weights = belief.particles[drawn.feature[k].slot].T
            drawn.feature[k].depth = rng.choice(depths, p=weights / weights.sum())
    shift_mean(drawn, _normal(belief.covariance[:dim, :dim], rng))
    feature, camera = drawn.feature[:n], drawn.state.camera
    origins = np.where((feature["kind"] == POINT)[:, None], camera[POSITION], feature["mean"][:, ANCHOR])
    return camera, _kept_inside(origins, positions_of(drawn), half)


def _normal(P: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A draw of N(0, P); of the nearest such P where it is not quite positive."""
    values, vectors = np.linalg.eigh(P)
    return vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(values)))


def _kept_inside(origins: np.ndarray, points: np.ndarray, half: np.ndarray) -> np.ndarray:
    """``points`` (n, 3), those outside of the room moved back on their lines of sight from ``origins`` (n, 3)."""
    way = points - origins
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(way == 0.0, 1.0, (np.copysign(half, way) - origins) / way).min(axis=1, initial=1.0)
    return origins + np.maximum(share, 0.0)[:, None] * way


def count_in_longer_frames(belief: Belief, stride: int) -> None:
    """Count in frames that are ``stride`` times as long."""
    frame, feature = int(belief.state.frame), belief.feature[: int(belief.state.count)]
    belief.state.frame = frame // stride
    for name in ("born", "seen"):
        feature[name] = frame // stride - (frame - feature[name]) // stride
    feature["misses"] //= stride
    belief.track["hits"] //= stride
