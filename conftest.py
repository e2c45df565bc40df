"""Property tests have no deadline: no test measures time, and a loaded machine is slow."""

from hypothesis import settings

settings.register_profile('suite', deadline=None)
settings.load_profile('suite')
