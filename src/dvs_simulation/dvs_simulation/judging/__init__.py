"""What a run is judged by: its signals, errors, sector ratios, verdict and figure."""
