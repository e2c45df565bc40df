"""Property tests have no deadline: no test measures time, and a loaded machine is slow."""

from hypothesis import settings

settings.register_profile('suite', deadline=None, max_examples=50)
settings.load_profile('suite')
