"""The encoder of the observation: landmarks are a set, so their tokens are encoded alike and pooled."""

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from activeslam_gym import ObservationLayout


class SetEncoder(BaseFeaturesExtractor):
    """Global features, and the mean and the maximum of the encoded tokens, which do not depend on their order.

    The number of tokens does not enter the weights, so that they serve a room with more landmarks. An empty token (its
    kind is all zero) is left out, and costs no time.

    Args:
        observation_space: The flat observation's.
        layout: Slices of its parts.
        width: Units of the encoded global features, and of an encoded token.
        token_width: Units of the hidden layer of tokens, of which there are many.
    """

    def __init__(
        self, observation_space: spaces.Box, layout: ObservationLayout, width: int = 64, token_width: int = 64
    ) -> None:
        super().__init__(observation_space, features_dim=3 * width)
        self.layout = layout
        kinds = [layout.token_slices[name] for name in ("fiducial", "expected", "initialising", "mapped")]
        self.kinds = slice(kinds[0].start, kinds[-1].stop)
        self.globals = nn.Sequential(nn.Linear(layout.tokens.start, width), nn.Tanh())
        self.tokens = nn.Sequential(
            nn.Linear(layout.token_shape[1], token_width), nn.ReLU(), nn.Linear(token_width, width), nn.ReLU()
        )

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """(B, D) -> (B, 3 width)."""
        tokens = observations[:, self.layout.tokens].unflatten(1, self.layout.token_shape)
        present = tokens[:, :, self.kinds].sum(dim=2) > 0.0
        general = self.globals(observations[:, : self.layout.tokens.start])
        return torch.cat([general, *self._pooled(tokens, present)], dim=1)

    def _pooled(self, tokens: torch.Tensor, present: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, T, W) and (B, T) -> mean and maximum (B, width) of the encoded tokens that are there."""
        encoded, row = self.tokens(tokens[present]), present.nonzero()[:, 0]
        none = encoded.new_zeros(len(tokens), encoded.shape[1])
        mean = none.index_add(0, row, encoded) / present.sum(dim=1, keepdim=True).clamp(min=1)
        return mean, none.scatter_reduce(0, row[:, None].expand_as(encoded), encoded, "amax")  # ReLU: 0 is the least
