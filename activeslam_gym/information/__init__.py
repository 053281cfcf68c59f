"""What a belief knows, and what an action would teach: entropy, criteria, and the scores of candidate actions.

Everything here works on the *public* belief, in which each feature is a point with a (12 + 3 n)^2 joint covariance.
For a feature that the filter holds in other parameters nothing is lost: both linearise at the same mean, so by the
chain rule H_point T P T^T H_point^T is the filter's own innovation covariance.
"""

from activeslam_gym.information.criteria import CRITERIA

__all__ = ["CRITERIA"]
