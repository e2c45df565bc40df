"""Property tests are the same at every run, and have no deadline: no test measures time."""

from hypothesis import settings

settings.register_profile('suite', deadline=None, max_examples=50, derandomize=True)
settings.load_profile('suite')
