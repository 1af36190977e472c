"""Knots that are found: how many a ``spline:auto`` gets, and where, by evidence.

Krulewich closed with the form of the polynomials as what limits a fit, and splines with knots where
they are needed as the way on. Every cubic spline with knots on a fine raster lies within the spline
on the whole raster, so one fit on the raster says what all others would leave. Knots are added
where they take most off χ², taken out where they take least, and moved, until no step pays any
more. What pays is Akaike's criterion, corrected for few rows: χ² plus twice the number of unknowns.
A knot counts as four, its coefficient and three for having been picked among many places (Friedman,
Multivariate adaptive regression splines, 1991). χ² is counted in units of what the finest splines
leave, so uncertainties that are stated too large or too small make no knots.

How sure the choice is: all sets that differ from it by one knot (more, fewer, elsewhere) have the
weight ``exp(−Δ/2)``, Δ their difference in the criterion. And because knots that were picked for
their fit make a model look surer than it is, the covariance is that of a wider one.
"""
