"""What a closed loop guarantees: norms, mu, sector, peak gains, thresholds, sampling."""
