"""What a network reads: an environment's observation, laid out as its weights know it."""

from dataclasses import replace

import numpy as np

from activeslam_gym import CONTEXT_FEATURES, ObservationLayout
from activeslam_gym.motion import MOTION_COUNT

CONTEXT_SIZE = sum(CONTEXT_FEATURES.values())
_FREE, _EMPTY = -2, -1  # columns that an observation lacks: nothing within reach, and no token


def common_size(layout: ObservationLayout, context: bool = True) -> int:
    """Numbers before the tokens in the input of a network for several scenarios: all global features, and the context.

    ``layout`` is that of any scenario.
    """
    return _general_size(layout) + MOTION_COUNT + CONTEXT_SIZE * context


def _general_size(layout: ObservationLayout) -> int:
    """Global features that every observation has: all but the range finders."""
    sensed = layout.global_slices.get("clearance", slice(0, 0))
    return layout.tokens.start - (sensed.stop - sensed.start)


class Inputs:
    """From observations to the inputs of a network whose weights read ``known`` numbers before the tokens.

    With `common_size` of them the context stands behind the global features. Where there are bodies, range finders
    stand behind the other global features: weights of a room without them read on without, and to weights of a room
    with them all is free where there are none.

    Args:
        layout: The observation's.
        known: Numbers before the tokens that the weights know; the observation's own if not given.
        tokens: Tokens of the input, of which those that the observation lacks are empty; its own if not given.

    Raises:
        ValueError: the observation has more ``tokens``.
    """

    def __init__(self, layout: ObservationLayout, known: int | None = None, tokens: int | None = None) -> None:
        start, general, (count, size) = layout.tokens.start, _general_size(layout), layout.token_shape
        own = start - general
        self.contextual = known == common_size(layout)
        width = known - CONTEXT_SIZE * self.contextual if known is not None else start
        if width not in (general, general + MOTION_COUNT):
            width, self.contextual = start, False  # weights of another observation, which will say so
        if (more := (count if tokens is None else tokens) - count) < 0:
            raise ValueError(f"tokens: {tokens}; allowed: {count} or more for this scenario's observation")
        finders = [np.arange(general, general + own), np.full(MOTION_COUNT - own, _FREE)] if width > general else []
        context = [layout.size + np.arange(CONTEXT_SIZE)] if self.contextual else []
        globals_ = np.concatenate([np.arange(general), *finders, *context])
        self._columns = np.concatenate([globals_, np.arange(start, layout.size), np.full(more * size, _EMPTY)])
        self.layout = replace(
            layout,
            tokens=slice(len(globals_), len(self._columns)),
            token_shape=(count + more, size),
            size=len(self._columns),
        )

    def __call__(self, observations: np.ndarray, context: np.ndarray | None = None) -> np.ndarray:
        """(B, D) and, where it is read, the context (B, `CONTEXT_SIZE`) -> (B, ``layout.size``) float32."""
        known = [observations] if context is None else [observations, context]
        filling = np.tile(np.array([1.0, 0.0], np.float32), (len(observations), 1))
        return np.concatenate([*known, filling], axis=1)[:, self._columns]
