"""The sampled loop, compiled: camera, controller and plant of one run in one function."""
