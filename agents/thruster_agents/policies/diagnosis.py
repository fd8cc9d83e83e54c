"""A policy that diagnoses: one small network, the same for every thruster, says how healthy that thruster is.

It reads, for each thruster, the last belief, the last duty, and how much on-time is missing: the expected
minus the measured rate change, projected on it. Weights are shared between thrusters, so that what is
learned from the failure of one holds for all. The new belief is the last one, plus a gain times what the last
firing says against it (the innovation), plus a change; gain, change and the size of the exploration noise are
what the network gives. It starts near "no change" of a belief that every thruster is healthy: close to the LP
what the network gives. It starts near "no change" of a belief that all thrusters are healthy: close to the LP
The value network sees the whole observation.

Left out: memory other than the belief itself, any knowledge of geometry beyond what the observation projects.
"""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

__all__ = ["DiagnosisPolicy"]

_FEATURES = 7
_SMALLEST_LOG_STD, _LARGEST_LOG_STD = -4.0, 0.5


class DiagnosisPolicy(ActorCriticPolicy):
    """For `ThrusterMapping-v0` under `BeliefAction`; what SB3's algorithms take as `policy`.

    Args:
        hidden: Units in each of the two layers of the network that thrusters share.
        value_hidden: Units in each of the two layers of the value network.
        log_std_init: Logarithm of the exploration noise at the start, in units of the action (2 is the
            whole range of health).
        *args, **kwargs: As for `ActorCriticPolicy`.

    Raises:
        ValueError: Spaces other than those of the task under `BeliefAction`.
    """

    def __init__(self, *args: Any, hidden: int = 32, value_hidden: int = 64, **kwargs: Any) -> None:
        self.hidden, self.value_hidden = hidden, value_hidden
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        if not isinstance(self.action_space, spaces.Box):
            raise ValueError(f"the action space is {self.action_space}; a Box would be right")
        # SB3 declares a class of its own here, and asks for nothing but these methods.
        self.mlp_extractor = _Networks(
            self.features_dim, self.action_space.shape[0], self.hidden, self.value_hidden, self.log_std_init
        )

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = nn.Identity()
        self.mlp_extractor.calm()
        self.log_std.requires_grad_(False)
        learned = [one for one in self.parameters() if one.requires_grad]
        self.optimizer = self.optimizer_class(learned, lr=lr_schedule(1.0), **self.optimizer_kwargs)

    def _get_action_dist_from_latent(self, latent_pi: torch.Tensor) -> Distribution:
        mean, log_std = latent_pi.chunk(2, dim=1)
        return self.action_dist.proba_distribution(mean, log_std)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        own = {"hidden": self.hidden, "value_hidden": self.value_hidden}
        return super()._get_constructor_parameters() | own


class _Networks(nn.Module):
    """What SB3 calls the extractor: the whole actor, and the value network up to its last layer."""

    def __init__(
        self, observation_size: int, thrusters: int, hidden: int, value_hidden: int, log_std: float
    ) -> None:
        super().__init__()
        if observation_size != 18 + 4 * thrusters:
            raise ValueError(
                f"the observation has {observation_size} numbers; {18 + 4 * thrusters}, those of "
                f"ThrusterMapping-v0 with {thrusters} thrusters under BeliefAction, would be right"
            )
        self.thrusters, self.log_std = thrusters, log_std
        # Columns of the fields of ThrusterMapping-v0, and of the belief that BeliefAction adds.
        self.duties = slice(6, 6 + thrusters)
        self.measured = slice(18 + thrusters, 18 + 2 * thrusters)
        self.expected = slice(18 + 2 * thrusters, 18 + 3 * thrusters)
        self.belief = slice(18 + 3 * thrusters, None)
        self.latent_dim_pi, self.latent_dim_vf = 2 * thrusters, value_hidden
        self.actor = nn.Sequential(
            nn.Linear(_FEATURES, hidden),
            nn.Tanh(),
            nn.Linear(hidden, hidden),
            nn.Tanh(),
            nn.Linear(hidden, 3),
        )
        self.critic = nn.Sequential(
            nn.Linear(observation_size + thrusters, value_hidden),
            nn.Tanh(),
            nn.Linear(value_hidden, value_hidden),
            nn.Tanh(),
        )

    def calm(self) -> None:
        """Begin near no change of belief, whatever is seen."""
        with torch.no_grad():
            self.actor[-1].weight.mul_(0.01)
            self.actor[-1].bias.zero_()

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.forward_actor(observations), self.forward_critic(observations)

    def forward_actor(self, observations: torch.Tensor) -> torch.Tensor:
        """(batch, 2 n): means, then logarithms of the noise."""
        features = self._features(observations)
        change, log_std, gain = self.actor(features).unbind(-1)
        belief, lost_share = features[..., 0], features[..., 3]
        innovation = 1.0 - 2.0 * lost_share.clamp(0.0, 1.0) - belief
        mean = belief + gain * innovation + change
        return torch.cat([mean, (self.log_std + log_std).clamp(_SMALLEST_LOG_STD, _LARGEST_LOG_STD)], dim=1)

    def forward_critic(self, observations: torch.Tensor) -> torch.Tensor:
        """(batch, value_hidden)."""
        return self.critic(torch.cat([observations, 3.0 * self._missing(observations)], dim=1))

    def _missing(self, observations: torch.Tensor) -> torch.Tensor:
        """(batch, n), expected minus measured rate change, projected on each thruster, in periods."""
        return observations[:, self.expected] - observations[:, self.measured]

    def _features(self, observations: torch.Tensor) -> torch.Tensor:
        """(batch, n, 7), what is known of each thruster; the first is the last belief as an action."""
        n = self.thrusters
        belief, duty = 2.0 * observations[:, self.belief] - 1.0, observations[:, self.duties]
        missing = self._missing(observations)
        largest = missing.abs().amax(dim=1, keepdim=True)
        lost_share = (missing / (duty + 0.005)).clamp(-1.5, 1.5)
        against_largest = missing / (largest + 1e-3)
        size = (torch.log(largest + 1e-3) / 3.0 + 1.0).expand(-1, n)
        stands_out = (4.0 * (against_largest - 0.75)).clamp(-1.0, 1.0)
        return torch.stack(
            [
                belief, 2.0 * duty - 1.0, (5.0 * missing).clamp(-2.0, 2.0), lost_share, against_largest,
                stands_out, size,
            ],
            dim=-1,
        )  # fmt: skip
