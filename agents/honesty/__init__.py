"""Is the filter honest? Whether its covariance means what it says, by the hidden labels of many runs."""
