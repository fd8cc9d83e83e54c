"""Settings of the whole test suite."""

from hypothesis import settings

# Compilation makes first examples slow, hence no deadline; a suite that fails must fail again, hence the same
# examples each time.
settings.register_profile("suite", deadline=None, derandomize=True)
settings.load_profile("suite")
