"""Patterns: structure in residuals that is in no catalogue, described by what it depends on.

A pattern is a product of recorded quantities, a smooth surface over two of them, or an oscillation,
on one error motion. Patterns compete with the catalogue's effects under the same exact test; they
describe, they do not explain. Where a short product of recorded quantities suffices, it is offered
as a ready ``formula`` effect, marked as empirical.
"""
