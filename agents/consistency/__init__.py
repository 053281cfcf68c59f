"""The consistency report: whether the filter's covariance is that of its errors."""
