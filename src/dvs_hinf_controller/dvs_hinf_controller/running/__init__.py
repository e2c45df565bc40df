"""The controller as it runs: estimator, synchroniser, exact propagation between events."""
