"""Trials: a scenario diagnosed, given to other learners, and judged on lines not seen before."""
