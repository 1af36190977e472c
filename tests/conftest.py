"""What all tests share: how Hypothesis searches."""

from hypothesis import settings

# The machine that runs the tests is shared: no deadlines; the same examples every time.
settings.register_profile("abbe", deadline=None, derandomize=True, print_blob=False)
settings.load_profile("abbe")
